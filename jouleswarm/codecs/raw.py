"""raw: observations as the environment shows them."""

from __future__ import annotations

from typing import Self

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import RAW
from jouleswarm.common.wire.tensorfile import code_of
from jouleswarm.common.wire.types import Layout, Shapes, Tensors


class Raw:
    """See `codecs.codec.Codec`."""

    name, lossless = RAW, True

    def __init__(self, dtype: str) -> None:
        """`dtype`: of the observations, NumPy's name."""
        self._code = code_of(dtype)

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        return cls(scenario.spaces.observation.dtype)

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        return {name: (self._code, tuple(shape)) for name, shape in shapes.items()}

    def encode(self, weights: Tensors, base: Tensors | None) -> Tensors:
        return dict(weights)

    def decode(self, tensors: Tensors, shapes: Shapes, base: Tensors | None) -> Tensors:
        return {name: tensors[name] for name in shapes}
