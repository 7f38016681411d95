"""How weights are written with fewer bits: pure functions from float32 arrays to what goes on the wire, and back.

- float32: as they are.
- float16: IEEE halves. What is beyond the largest half, 65504, is clipped to it: a half of it would be infinite.
- int8: each tensor in steps of its own scale, max |w| / 127, from -127 to 127; the float32 scales go along.
- topk: the entries that differ most from what receivers hold, over all tensors together; the rest is left as the
  receivers have it. What was not sent stays in the difference to the next model, so that nothing is lost for good
  (error feedback). An entry is sent as its new float32 value and not as a difference: as many bits, no rounding
  error, and harmless when it comes twice. Without a base (the first message) the model is sent whole.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from jouleswarm.common.errors import PayloadError

CodecName = Literal["float32", "float16", "int8", "topk"]
ExperienceCodec = Literal["raw", "png", "resized"]

Array = npt.NDArray[Any]
Weights = dict[str, npt.NDArray[np.float32]]
Tensors = dict[str, Array]
Shapes = Mapping[str, tuple[int, ...]]
Layout = Mapping[str, tuple[str, tuple[int, ...]]]
"""Tensor name -> safetensors dtype and shape, in the order of the file."""

MAX_WEIGHT = 1e4
"""The largest |w| that is sent or taken. Networks trained here stay below 10. Within it no forward pass can overflow
float32: the full-size network's fan-ins 256 x 512 x 576 x 2560 x 512 times (1e4)^5 are 1e34."""

VALUES, INDICES = "topk.values", "topk.indices"
_SCALE = ".scale"
_LARGEST_HALF = np.float32(np.finfo(np.float16).max)
_LARGEST_SCALE = float(np.nextafter(np.float32(MAX_WEIGHT / 127), np.float32(np.inf)))  # see _scale
_LARGEST, _LEAST = np.finfo(np.float32).max, np.finfo(np.float32).smallest_subnormal


class WeightsCodec(NamedTuple):
    """A scenario's choice."""

    name: CodecName = "float32"
    topk_share: float = 0.05
    """Share of the entries that a topk message holds, rounded up to a whole entry."""

    @property
    def is_lossless(self) -> bool:
        """Whether receivers hold the sender's model to the bit."""
        return self.name == "float32"


FLOAT32 = WeightsCodec()


def layouts(codec: WeightsCodec, shapes: Shapes) -> list[Layout]:
    """What a message may hold: one layout; two with topk, the whole model and its differences."""
    if codec.name == "float16":
        return [{name: ("F16", tuple(shape)) for name, shape in shapes.items()}]
    if codec.name == "int8":
        # The scales first: float32 must begin at a multiple of 4 bytes for tools that map a file into memory.
        scales: dict[str, tuple[str, tuple[int, ...]]] = {name + _SCALE: ("F32", ()) for name in shapes}
        return [{**scales, **{name: ("I8", tuple(shape)) for name, shape in shapes.items()}}]
    whole = {name: ("F32", tuple(shape)) for name, shape in shapes.items()}
    if codec.name == "float32":
        return [whole]
    sent = topk_entries(_entries(shapes), codec.topk_share)
    return [whole, {VALUES: ("F32", (sent,)), INDICES: ("I32", (sent,))}]


def encode(codec: WeightsCodec, weights: Mapping[str, Array], base: Mapping[str, Array] | None = None) -> Tensors:
    """Finite float32 `weights` as tensors for the wire. `base`: what receivers hold, of use to topk alone."""
    if codec.name == "float16":
        return {name: _to_half(tensor) for name, tensor in weights.items()}
    if codec.name == "int8":
        scales = {name: _scale(tensor) for name, tensor in weights.items()}
        return {
            **{name + _SCALE: np.array(scale, np.float32) for name, scale in scales.items()},
            **{name: _to_steps(tensor, scales[name]) for name, tensor in weights.items()},
        }
    if codec.name == "topk" and base is not None:
        return _to_topk(_flat(weights), _flat(base), codec.topk_share)
    return dict(weights)


def decode(
    codec: WeightsCodec, tensors: Mapping[str, Array], shapes: Shapes, base: Mapping[str, Array] | None = None
) -> Weights:
    """The model that receivers hold after checked `tensors`, float32; `base` is the one they held before.

    Raises:
        PayloadError: differences, and no base to apply them to.
    """
    if codec.name == "float16":
        return {name: tensors[name].astype(np.float32) for name in shapes}
    if codec.name == "int8":
        return {name: _from_steps(tensors[name], tensors[name + _SCALE]) for name in shapes}
    if not is_difference(tensors):
        return {name: tensors[name] for name in shapes}
    if base is None:
        raise PayloadError("differences to a model that is not here, expected a whole model first")
    flat = _flat(base)  # a copy: models handed out before stay as they are
    flat[tensors[INDICES]] = tensors[VALUES]
    return _unflat(flat, shapes)


def check(tensors: Mapping[str, Array], shapes: Shapes) -> None:
    """Hold what came in one of the `layouts` against what an encoder can have sent.

    Raises:
        PayloadError: a weight that is not finite or beyond `MAX_WEIGHT`, a negative scale, or indices out of range
            or order.
    """
    for name, tensor in tensors.items():
        if tensor.dtype == np.int8:
            _check_steps(name, tensor, float(tensors[name + _SCALE]))
        elif tensor.dtype.kind == "f":
            check_weights(name, tensor)
    if is_difference(tensors):
        indices, entries = tensors[INDICES], _entries(shapes)
        if indices[0] < 0 or indices[-1] >= entries or (indices[1:] <= indices[:-1]).any():
            raise PayloadError(f"{INDICES} are not ascending from 0 to {entries - 1}")


def check_weights(name: str, tensor: Array) -> None:
    """Hold float weights against `MAX_WEIGHT`.

    Raises:
        PayloadError: one is not finite, or larger.
    """
    largest = largest_weight(tensor)
    if not math.isfinite(largest):
        raise PayloadError(f"{name} is not finite")
    if largest > MAX_WEIGHT:
        raise PayloadError(f"{name} has a weight of size {largest:g}, expected at most {MAX_WEIGHT:g}")


def largest_weight(tensor: Array) -> float:
    """Largest |w| of a float16 or float32 tensor; NaN or infinite where any weight is."""
    if tensor.dtype == np.float16:
        # Without their signs halves are in the order of their bits. numpy compares halves themselves one by one.
        bits = (tensor.view(np.uint16) & 0x7FFF).max(initial=0)
        return float(np.uint16(bits).view(np.float16))
    return float(np.maximum(tensor.max(initial=0), -tensor.min(initial=0)))  # hands NaN on, as max and min do


def is_difference(tensors: Mapping[str, Array]) -> bool:
    """Whether a message needs a base to be read."""
    return INDICES in tensors


def topk_entries(entries: int, share: float) -> int:
    """Entries of a topk message; 0.07 of 100 are 7, whatever the product is in binary."""
    return max(1, math.ceil(share * entries - 1e-6))


def weights_bytes(codec: WeightsCodec, tensor_entries: Sequence[int], *, whole: bool = False) -> int:
    """Bytes of a message's tensors, header apart, for a model with so many entries in each tensor.

    `whole`: a message without a base (an arm's first, or a meta-model), which topk sends in float32.
    """
    entries = sum(tensor_entries)
    if codec.name == "float16":
        return 2 * entries
    if codec.name == "int8":
        return entries + 4 * len(tensor_entries)
    if codec.name == "topk" and not whole:
        return 8 * topk_entries(entries, codec.topk_share)
    return 4 * entries


def _check_steps(name: str, steps: Array, scale: float) -> None:
    if not math.isfinite(scale):
        raise PayloadError(f"{name}{_SCALE} is not finite")
    if scale < 0:
        raise PayloadError(f"{name}{_SCALE} is {scale}, expected 0 or more")
    if scale > _LARGEST_SCALE:
        raise PayloadError(f"{name}{_SCALE} is {scale:g}, expected at most {_LARGEST_SCALE:g}")
    if steps.min(initial=0) < -127:
        raise PayloadError(f"{name} has a step of -128, expected -127 to 127")


def _to_half(tensor: Array) -> Array:
    return np.clip(tensor, -_LARGEST_HALF, _LARGEST_HALF).astype(np.float16)


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


def _to_topk(flat: Array, base: Array, share: float) -> Tensors:
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
