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


def encoded(codec: Codec, weights: Weights, base: Weights | None) -> Tensors:
    """`weights` for the wire, in the order of the codec's layout.

    Raises:
        TrainingError: the codec cannot, or does not keep to its layout.
    """
    shapes = {name: tensor.shape for name, tensor in weights.items()}
    try:
        layout, tensors = codec.layout(shapes, base is None), codec.encode(weights, base)
    except Exception as error:  # a codec may be anybody's
        raise TrainingError(f"codec {codec.name}: encode raises {_told(codec, error)}") from error
    if not isinstance(tensors, dict) or not all(isinstance(each, np.ndarray | np.generic) for each in tensors.values()):
        raise TrainingError(f"codec {codec.name}: encode gives {type(tensors).__name__}, expected a dict of arrays")
    if (found := layout_of(tensors)) != layout:
        raise TrainingError(f"codec {codec.name}: encode does not keep to its layout: {_unlike(found, layout)}")
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
    try:
        weights: Any = codec.decode(tensors, shapes, base)
    except Exception as error:  # a codec may be anybody's
        raise PayloadError(f"codec {codec.name}: decode raises {_told(codec, error)}") from error
    return _checked(codec, weights, shapes)


def read_model(payload: Payload, shapes: Shapes, codec: Codec) -> tuple[Tensors, ModelHeader]:
    """A model's tensors as its codec left them, checked and ready for `codecs.streams.WeightsDecoder`.

    Raises:
        PayloadError: as `common.wire.models.read_tensors`, or differences in a first round.
    """
    whole, differences = codec.layout(shapes, whole=True), codec.layout(shapes, whole=False)

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
    check = getattr(codec, "check", None)
    if check is None:
        check_floats(tensors)
        return
    try:
        check(tensors, shapes)
    except PayloadError:
        raise
    except Exception as error:  # a codec may be anybody's
        raise PayloadError(f"codec {codec.name}: {error or type(error).__name__}") from error


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
    return codec.layout(shapes, whole=True) == codec.layout(shapes, whole=False)


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
    name = next(name for name in [*layout, *found] if found.get(name) != layout.get(name))
    return f"{name} is {found.get(name)}, expected {layout.get(name)}"


def _told(codec: Codec, error: Exception) -> str:
    """An error in a codec, with the line of the codec's own file."""
    file = getattr(sys.modules.get(type(codec).__module__), "__file__", None)
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return f"{type(error).__name__}: {error}" + (f" ({Path(file).name}, line {lines[-1]})" if file and lines else "")
