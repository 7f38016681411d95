"""Models through a codec that may be anybody's: what it gives is held against what it promises."""

from __future__ import annotations

import sys
import traceback
from pathlib import Path
from typing import Any

import numpy as np

from jouleswarm.codecs.codec import Codec, is_whole
from jouleswarm.common.errors import PayloadError, TrainingError
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.models import MAX_WEIGHT, check_floats, largest_weight, read_tensors
from jouleswarm.common.wire.tensorfile import layout_of
from jouleswarm.common.wire.types import Layout, Payload, Shapes, Tensors, Weights

MAX_DECODED = 2 * MAX_WEIGHT
"""The largest |w| that may come out of a codec: what is lost in encoding may carry past what is sent."""


def encoded(codec: Codec, weights: Tensors, base: Weights | None) -> Tensors:
    """`weights`, or what else the codec takes, for the wire, in the order of the codec's layout.

    Raises:
        TrainingError: the codec cannot, or does not keep to its layout.
    """
    shapes = {name: tensor.shape for name, tensor in weights.items()}
    try:
        layout, tensors = called(codec, "layout", shapes, base is None), called(codec, "encode", weights, base)
    except PayloadError as error:
        raise TrainingError(str(error)) from error
    if not isinstance(tensors, dict) or not all(isinstance(each, np.ndarray | np.generic) for each in tensors.values()):
        raise TrainingError(f"codec {codec.name}: encode gives {type(tensors).__name__}, expected a dict of arrays")
    if (found := layout_of(tensors)) != layout and (wrong := _unlike(found, layout)):
        raise TrainingError(f"codec {codec.name}: encode does not keep to its layout: {wrong}")
    return {name: np.asarray(tensors[name]) for name in layout}


def decoded(codec: Codec, tensors: Tensors, shapes: Shapes, base: Weights | None) -> Weights:
    """The model that receivers hold after checked `tensors`; `base`: the one before, None: there was none.

    Raises:
        PayloadError: differences and no base, or what the codec makes of them is no model of these shapes.
    """
    whole = is_whole(codec, tensors, shapes)
    if base is None and not whole:
        raise PayloadError("differences to a model that is not here, expected a whole model first")
    if whole and not _looks_alike(codec, shapes):
        base = None
    return _checked(codec, called(codec, "decode", tensors, shapes, base), shapes)


def called(codec: Codec, method: str, *arguments: Any) -> Any:
    """What a method of a codec returns; the codec may be anybody's.

    Raises:
        PayloadError: whatever it raises, in one line, with the line of the codec's own file.
    """
    try:
        return getattr(codec, method)(*arguments)
    except PayloadError:
        raise
    except Exception as error:
        told = f"{type(error).__name__}: {' '.join(str(error).split())}{_line(codec, error)}"
        raise PayloadError(f"codec {codec.name}: {method} raises {told}") from error


def read_model(payload: Payload, shapes: Shapes, codec: Codec) -> tuple[Tensors, ModelHeader]:
    """A model's tensors as its codec left them, checked and ready for `codecs.streams.WeightsDecoder`.

    Raises:
        PayloadError: as `common.wire.models.read_tensors`, or differences in a first round.
    """
    whole, differences = codec.layout(shapes, True), codec.layout(shapes, False)

    def check(tensors: Tensors, header: ModelHeader) -> None:
        if header.round <= 1 and not is_whole(codec, tensors, shapes):
            raise PayloadError("differences, expected a whole model in the first round")
        check_tensors(codec, tensors, shapes)

    layouts = [whole] if differences == whole else [whole, differences]
    return read_tensors(payload, layouts, codec.name, check)


def check_tensors(codec: Codec, tensors: Tensors, shapes: Shapes) -> None:
    """Hold tensors of the right layout against what an encoder can have sent.

    Raises:
        PayloadError: it cannot have sent these.
    """
    if hasattr(codec, "check"):
        called(codec, "check", tensors, shapes)
    else:
        check_floats(tensors)


def builds_on_base(codec: Codec) -> bool:
    """Whether a message is read otherwise by who holds another base, or none: found out by trying it."""
    rng, shapes = np.random.default_rng(1), {"w": (4, 5)}
    if not _looks_alike(codec, shapes):
        return True
    weights, base, other = ({"w": rng.normal(size=(4, 5)).astype(np.float32)} for _ in range(3))
    tensors = encoded(codec, weights, base)
    one, two = (decoded(codec, tensors, shapes, each)["w"] for each in (base, other))
    return one.tobytes() != two.tobytes()


def _looks_alike(codec: Codec, shapes: Shapes) -> bool:
    """Whether messages with a base and without one cannot be told apart."""
    return codec.layout(shapes, True) == codec.layout(shapes, False)


def _checked(codec: Codec, weights: Any, shapes: Shapes) -> Weights:
    if not isinstance(weights, dict) or weights.keys() != shapes.keys():
        got = list(weights) if isinstance(weights, dict) else type(weights).__name__
        raise PayloadError(f"codec {codec.name}: decode gives {got}, expected {list(shapes)}")
    for name, shape in shapes.items():
        tensor, told = np.asarray(weights[name]), f"codec {codec.name}: decode gives {name}"
        if tensor.dtype != np.float32 or tensor.shape != shape:
            raise PayloadError(f"{told} as {tensor.dtype} {tensor.shape}, expected float32 {shape}")
        # One with a check of its own vouches for what passed it.
        if not hasattr(codec, "check") and not (largest := largest_weight(tensor)) <= MAX_DECODED:
            raise PayloadError(f"{told} a weight of size {largest:g}, expected at most {MAX_DECODED:g}")
    return {name: np.asarray(weights[name]) for name in shapes}


def _unlike(found: Layout, layout: Layout) -> str:
    """The first tensor that is not as laid out, if there is one."""
    for name in [*layout, *found]:
        got, wanted = ("{} {}".format(*each[name]) if name in each else "not there" for each in (found, layout))
        if got != wanted and not (name in found and name in layout and _varies(found[name], layout[name])):
            return f"{name} is {got}, expected {wanted}"
    return ""


def _varies(found: tuple[str, tuple[int, ...]], layout: tuple[str, tuple[int, ...]]) -> bool:
    """Whether a tensor fits into a layout with a size of -1, which is any."""
    (code, shape), (wanted, sizes) = found, layout
    return (code, len(shape)) == (wanted, len(sizes)) and all(
        size in (each, -1) for each, size in zip(shape, sizes, strict=True)
    )


def _line(codec: Codec, error: Exception) -> str:
    file = getattr(sys.modules.get(type(codec).__module__), "__file__", None)
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return f" ({Path(file).name}, line {lines[-1]})" if file and lines else ""
