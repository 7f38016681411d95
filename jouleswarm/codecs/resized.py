"""resized: images scaled to the network's input before they are sent, as the data center would do after."""

from __future__ import annotations

from typing import Self

from jouleswarm.codecs.frames import shrink
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.types import Layout, Shapes, Tensors


class Resized:
    """See `codecs.codec.Codec`."""

    name, lossless = "resized", False

    def __init__(self, kept: Observation) -> None:
        """`kept`: an image of the network's size."""
        self._kept = kept

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        shown = scenario.spaces.observation
        if not shown.is_image:
            raise ConfigurationError(f"for images, the environment shows {shown}; expected raw")
        return cls(shown.kept(scenario.network))

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        return dict.fromkeys(shapes, ("U8", self._kept.shape))

    def encode(self, weights: Tensors, base: Tensors | None) -> Tensors:
        return {name: shrink(image, self._kept) for name, image in weights.items()}

    def decode(self, tensors: Tensors, shapes: Shapes, base: Tensors | None) -> Tensors:
        return {name: tensors[name] for name in shapes}
