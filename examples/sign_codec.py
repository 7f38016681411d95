"""Signs with a scale: one bit an entry. In a scenario: `federation.codec = "sign_codec:Sign"` (see docs/doors.md).

The first message is the whole model. Each later one tells of every tensor in which direction its entries have moved
from what the receivers hold, and how far on average (Bernstein et al. 2018; Karimireddy et al. 2019). What a message
could not tell is in the difference to the next model: the core keeps what receivers hold.
"""

from math import prod

import numpy as np


class Sign:
    name, lossless = "sign", False

    def layout(self, shapes, whole):
        if whole:
            return {key: ("F32", shape) for key, shape in shapes.items()}
        scales = {f"{key}.scale": ("F32", ()) for key in shapes}
        return scales | {key: ("U8", ((prod(shape) + 7) // 8,)) for key, shape in shapes.items()}

    def encode(self, weights, base):
        if base is None:
            return dict(weights)
        moved = {key: value - base[key] for key, value in weights.items()}
        scales = {f"{key}.scale": np.float32(abs(step).mean()) for key, step in moved.items()}
        return scales | {key: np.packbits(step.ravel() >= 0) for key, step in moved.items()}

    def decode(self, tensors, shapes, base):
        if base is None:
            return {key: tensors[key] for key in shapes}
        return {key: base[key] + tensors[f"{key}.scale"] * _signs(tensors[key], shapes[key]) for key in shapes}


def _signs(bits, shape):
    """1 for each bit that is set and -1 for the others, float32."""
    return np.unpackbits(bits, count=prod(shape)).reshape(shape) * np.float32(2) - 1
