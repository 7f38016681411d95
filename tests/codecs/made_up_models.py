"""A made-up model of eight weights, the codecs that ship here, and headers of its messages."""

from __future__ import annotations

import numpy as np

from jouleswarm.codecs.codec import Codec
from jouleswarm.codecs.floats import FLOAT32, Float16
from jouleswarm.codecs.int8 import Int8
from jouleswarm.codecs.topk import TopK
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.types import Weights

HALF, INT8 = Float16(), Int8()
CODECS: list[Codec] = [FLOAT32, HALF, INT8, TopK(0.25)]
SHAPES = {"a": (2, 3), "b": (2,)}
HEADER = ModelHeader(task=2, agent=3, round=9, reward=41.5, samples=20, rewards={3: (9, 40.0), 4: (8, 43.0)})
FIRST = HEADER.model_copy(update={"round": 1, "rewards": {3: (1, 40.0)}})


def model(values: list[float]) -> Weights:
    flat = np.array(values, np.float32)
    return {"a": flat[:6].reshape(2, 3), "b": flat[6:]}


def vector(*values: float) -> Weights:
    return {"w": np.array(values, np.float32)}
