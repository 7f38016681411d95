"""int8: each tensor in steps of its own scale, max |w| / 127, from -127 to 127; the float32 scales go along."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire.models import MAX_WEIGHT
from jouleswarm.common.wire.types import Array, Layout, Shapes, Tensors, Weights

_SCALE = ".scale"
_LARGEST_SCALE = float(np.nextafter(np.float32(MAX_WEIGHT / 127), np.float32(np.inf)))  # see _scale
_LARGEST, _LEAST = np.finfo(np.float32).max, np.finfo(np.float32).smallest_subnormal


class Int8:
    """See `codecs.codec.Codec`."""

    name, lossless = "int8", False

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        # The scales first: float32 must begin at a multiple of 4 bytes for tools that map a file into memory.
        scales: dict[str, tuple[str, tuple[int, ...]]] = {name + _SCALE: ("F32", ()) for name in shapes}
        return {**scales, **{name: ("I8", tuple(shape)) for name, shape in shapes.items()}}

    def encode(self, weights: Weights, base: Weights | None) -> Tensors:
        scales = {name: _scale(tensor) for name, tensor in weights.items()}
        return {
            **{name + _SCALE: np.array(scale, np.float32) for name, scale in scales.items()},
            **{name: _to_steps(tensor, scales[name]) for name, tensor in weights.items()},
        }

    def decode(self, tensors: Tensors, shapes: Shapes, base: Weights | None) -> Weights:
        return {name: _from_steps(tensors[name], tensors[name + _SCALE]) for name in shapes}

    def check(self, tensors: Tensors, shapes: Shapes) -> None:
        for name in shapes:
            _check_steps(name, tensors[name], float(tensors[name + _SCALE]))


def _check_steps(name: str, steps: Array, scale: float) -> None:
    if not math.isfinite(scale):
        raise PayloadError(f"{name}{_SCALE} is not finite")
    if scale < 0:
        raise PayloadError(f"{name}{_SCALE} is {scale}, expected 0 or more")
    if scale > _LARGEST_SCALE:
        raise PayloadError(f"{name}{_SCALE} is {scale:g}, expected at most {_LARGEST_SCALE:g}")
    if steps.min(initial=0) < -127:
        raise PayloadError(f"{name} has a step of -128, expected -127 to 127")


def _scale(tensor: Array) -> np.float32:
    """The least float32 of which 127 steps reach the largest entry."""
    largest = float(np.abs(tensor).max(initial=0))
    scale = np.float32(largest / 127)
    return np.nextafter(scale, np.float32(np.inf)) if float(scale) * 127 < largest else scale


def _to_steps(tensor: Array, scale: np.float32) -> Array:
    # in float64, where a quotient half way between two steps is half way
    return np.rint(tensor / np.float64(max(scale, _LEAST))).astype(np.int8)


def _from_steps(steps: Array, scale: Array) -> npt.NDArray[np.float32]:
    with np.errstate(over="ignore"):  # the last of 127 steps can be past the largest float32 by a rounding
        product = np.asarray(steps * scale, np.float32)
    return np.clip(product, -_LARGEST, _LARGEST)
