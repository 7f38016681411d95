"""Models as messages: safetensors files with the paper's fields in their metadata, and what weights may be."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.tensorfile import decode_tensors, encode_tensors
from jouleswarm.common.wire.types import Array, Layout, Payload, Tensors

PLAIN = "float32"
"""The codec of a model whose header names none."""
MAX_WEIGHT = 1e4
"""The largest |w| that is sent or taken. Networks trained here stay below 10. Within it no forward pass can overflow
float32: the full-size network's fan-ins 256 x 512 x 576 x 2560 x 512 times (1e4)^5 are 1e34."""


def encode_model(tensors: Mapping[str, Array], header: ModelHeader, robots: int = 0) -> bytes:
    """A model as a safetensors file: float32 weights, or what a codec made of them; tensors in the order given.

    The file is as long as with the rewards of `robots` robots, however many are known yet.
    """
    return encode_tensors(tensors, header, 320 + 48 * max(robots, len(header.rewards)))


def read_tensors(
    payload: Payload, layouts: Sequence[Layout], codec: str, check: Callable[[Tensors, ModelHeader], None]
) -> tuple[Tensors, ModelHeader]:
    """A model's tensors as the codec of this name left them, in one of `layouts` and checked by `check`.

    Raises:
        PayloadError: not a safetensors file, another schema, other names, shapes or dtypes, another codec's, or what
            `check` raises, with the sender named.
    """
    tensors, header = decode_tensors(payload, layouts, ModelHeader, f"model in {codec}")
    try:
        if (header.codec or PLAIN) != codec:
            raise PayloadError(f"in {header.codec or PLAIN}, expected {codec}")
        check(tensors, header)
    except PayloadError as error:
        raise PayloadError(f"model of robot {header.agent}, round {header.round}: {error}") from error
    return tensors, header


def check_floats(tensors: Mapping[str, Array]) -> None:
    """Hold every tensor of floats against `MAX_WEIGHT`.

    Raises:
        PayloadError: a value is not finite, or larger.
    """
    for name, tensor in tensors.items():
        if tensor.dtype.kind == "f":
            check_weights(name, tensor)


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
    """Largest |w| of a tensor of floats; NaN or infinite where any weight is."""
    if tensor.dtype == np.float16:
        # Without their signs halves are in the order of their bits. numpy compares halves themselves one by one.
        bits = (tensor.view(np.uint16) & 0x7FFF).max(initial=0)
        return float(np.uint16(bits).view(np.float16))
    return float(np.maximum(tensor.max(initial=0), -tensor.min(initial=0)))  # hands NaN on, as max and min do
