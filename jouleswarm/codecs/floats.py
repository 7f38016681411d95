"""Weights as floats.

- float32: as they are.
- float16: IEEE halves. What is beyond the largest half, 65504, is clipped to it: a half of it would be infinite.
"""

from __future__ import annotations

import numpy as np

from jouleswarm.common.wire.models import PLAIN, check_floats
from jouleswarm.common.wire.types import Layout, Shapes, Tensors, Weights

_LARGEST_HALF = np.float32(np.finfo(np.float16).max)


class Float32:
    """See `codecs.codec.Codec`."""

    name, lossless = PLAIN, True

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        return {name: ("F32", tuple(shape)) for name, shape in shapes.items()}

    def encode(self, weights: Weights, base: Weights | None) -> Tensors:
        return dict(weights)

    def decode(self, tensors: Tensors, shapes: Shapes, base: Weights | None) -> Weights:
        return {name: tensors[name] for name in shapes}

    def check(self, tensors: Tensors, shapes: Shapes) -> None:
        check_floats(tensors)


class Float16:
    """See `codecs.codec.Codec`."""

    name, lossless = "float16", False

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        return {name: ("F16", tuple(shape)) for name, shape in shapes.items()}

    def encode(self, weights: Weights, base: Weights | None) -> Tensors:
        return {
            name: np.clip(tensor, -_LARGEST_HALF, _LARGEST_HALF).astype(np.float16) for name, tensor in weights.items()
        }

    def decode(self, tensors: Tensors, shapes: Shapes, base: Weights | None) -> Weights:
        return {name: tensors[name].astype(np.float32) for name in shapes}

    def check(self, tensors: Tensors, shapes: Shapes) -> None:
        check_floats(tensors)


FLOAT32 = Float32()
