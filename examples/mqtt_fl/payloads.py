"""Four ways to put the same tensors into bytes. Whoever decodes knows the layout, and nothing is ever unpickled."""

from __future__ import annotations

import json
import pickle
import pickletools
from collections.abc import Callable
from math import prod
from typing import NamedTuple

import numpy as np
import safetensors.numpy

Tensors = dict[str, np.ndarray]
FEATURES, OUTPUTS = 64, 10
LAYOUT: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "bias": (np.float32, (OUTPUTS,)),
    "from": (np.int32, (2,)),  # device and round
    "weight": (np.float32, (FEATURES, OUTPUTS)),
}
_SIZES = [np.dtype(dtype).itemsize * prod(shape) for dtype, shape in LAYOUT.values()]
_BUFFERS = ("BINBYTES", "SHORT_BINBYTES")


class Encoding(NamedTuple):
    """Tensors of LAYOUT to bytes and back; bytes that are none raise an exception and do nothing else."""

    encode: Callable[[Tensors], bytes]
    decode: Callable[[bytes], Tensors]


def to_json(tensors: Tensors) -> bytes:
    return json.dumps({name: tensor.tolist() for name, tensor in tensors.items()}).encode()


def from_json(data: bytes) -> Tensors:
    held = json.loads(data)
    return {name: np.array(held[name], dtype).reshape(shape) for name, (dtype, shape) in LAYOUT.items()}


def to_pickle(tensors: Tensors) -> bytes:
    return pickle.dumps(tensors, protocol=4)


def from_pickle(data: bytes) -> Tensors:
    """Unpickling what came over a network would run whatever it says. Here its opcodes are listed, not run, and the
    arrays' buffers are taken from between them: LAYOUT knows what they are."""
    found = [held for opcode, held, _ in pickletools.genops(data) if opcode.name in _BUFFERS and len(held) > 1]
    if [len(buffer) for buffer in found] != _SIZES:
        raise ValueError(f"buffers of {[len(buffer) for buffer in found]} bytes, expected {_SIZES}")
    return {
        name: np.frombuffer(buffer, dtype).reshape(shape)
        for buffer, (name, (dtype, shape)) in zip(found, LAYOUT.items(), strict=True)
    }


def to_int8(tensors: Tensors) -> bytes:
    """Each tensor of floats as whole numbers from -127 to 127, and its scale."""
    packed: Tensors = {}
    for name, tensor in tensors.items():
        if tensor.dtype == np.float32:
            scale = np.float32(abs(tensor).max() / 127 or 1)
            packed |= {name: np.rint(tensor / scale).astype(np.int8), f"{name}.scale": np.array(scale)}
        else:
            packed[name] = tensor
    return safetensors.numpy.save(packed)


def from_int8(data: bytes) -> Tensors:
    held = safetensors.numpy.load(data)
    return {name: held[name] * held.get(f"{name}.scale", np.int32(1)) for name in LAYOUT}


ENCODINGS = {
    "JSON lists": Encoding(to_json, from_json),
    "pickle": Encoding(to_pickle, from_pickle),
    "safetensors": Encoding(safetensors.numpy.save, safetensors.numpy.load),
    "int8": Encoding(to_int8, from_int8),
}
