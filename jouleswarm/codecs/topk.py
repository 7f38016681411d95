"""topk: the entries that differ most from what receivers hold, over all tensors together; the rest they keep.

What was not sent stays in the difference to the next model, so that nothing is lost for good (error feedback). An entry
is sent as its new float32 value and not as a difference: as many bits, no rounding error, and harmless when it comes
twice. Without a base (the first message) the model is sent whole.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Self

import numpy as np

from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.models import check_floats
from jouleswarm.common.wire.types import Array, Layout, Shapes, Tensors, Weights

VALUES, INDICES = "topk.values", "topk.indices"


class TopK:
    """See `codecs.codec.Codec`."""

    name, lossless = "topk", False

    def __init__(self, share: float = 0.05) -> None:
        """`share`: of the entries that a message holds, rounded up to a whole entry."""
        self.share = share

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        return cls(scenario.federation.topk_share)

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        if whole:
            return {name: ("F32", tuple(shape)) for name, shape in shapes.items()}
        sent = topk_entries(_entries(shapes), self.share)
        return {VALUES: ("F32", (sent,)), INDICES: ("I32", (sent,))}

    def encode(self, weights: Weights, base: Weights | None) -> Tensors:
        return dict(weights) if base is None else _most_changed(_flat(weights), _flat(base), self.share)

    def decode(self, tensors: Tensors, shapes: Shapes, base: Weights | None) -> Weights:
        if base is None:
            return {name: tensors[name] for name in shapes}
        flat = _flat(base)  # a copy: models handed out before stay as they are
        flat[tensors[INDICES]] = tensors[VALUES]
        return _unflat(flat, shapes)

    def check(self, tensors: Tensors, shapes: Shapes) -> None:
        check_floats(tensors)
        if INDICES in tensors:
            indices, entries = tensors[INDICES], _entries(shapes)
            if indices[0] < 0 or indices[-1] >= entries or (indices[1:] <= indices[:-1]).any():
                raise PayloadError(f"{INDICES} are not ascending from 0 to {entries - 1}")


def topk_entries(entries: int, share: float) -> int:
    """Entries of a topk message; 0.07 of 100 are 7, whatever the product is in binary."""
    return max(1, math.ceil(share * entries - 1e-6))


def _most_changed(flat: Array, base: Array, share: float) -> Tensors:
    """The entries with the largest |difference|, equal ones by their order, in the order of their indices."""
    with np.errstate(over="ignore"):
        distance = np.abs(flat - base)
    sent = topk_entries(len(flat), share)
    least = np.partition(distance, len(flat) - sent)[len(flat) - sent]
    above, ties = np.flatnonzero(distance > least), np.flatnonzero(distance == least)
    indices = np.sort(np.concatenate([above, ties[: sent - len(above)]])).astype(np.int32)
    return {VALUES: flat[indices], INDICES: indices}


def _entries(shapes: Shapes) -> int:
    return sum(math.prod(shape) for shape in shapes.values())


def _flat(weights: Mapping[str, Array]) -> Array:
    return np.concatenate([tensor.reshape(-1) for tensor in weights.values()])


def _unflat(flat: Array, shapes: Shapes) -> Weights:
    ends = np.cumsum([math.prod(shape) for shape in shapes.values()])
    parts = np.split(flat, ends[:-1])
    return {name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)}
