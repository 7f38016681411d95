"""What passes between a robot, its environment and its network, as plain values: sizes follow from them alone, without
the environment, the network or PyTorch.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict

from jouleswarm.common.scenario.sections import Network

PNG_CHANNELS = {1: ("grey", 0), 3: ("RGB", 2), 4: ("RGBA", 6)}
"""Channels of an image that PNG can hold -> their name and PNG's colour type."""


class Observation(BaseModel):
    """An array that an environment shows, or that is kept of it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    shape: tuple[int, ...]
    """Images as (height, width, channels); () is one number."""
    dtype: str
    """NumPy's name."""
    values: int | None = None
    """Of a Discrete space: the number is from 0 to values - 1, and reaches the network one-hot."""

    @property
    def is_image(self) -> bool:
        """Whether it is pixels: uint8 [height, width, channels]."""
        return self.dtype == "uint8" and len(self.shape) == 3

    @property
    def nbytes(self) -> int:
        """Bytes of the array."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize

    @property
    def fed(self) -> tuple[int, ...]:
        """Shape of what the network gets, float32, for one of these: images channels first, numbers one-hot."""
        if self.values is not None:
            return (self.values,)
        if self.is_image:
            height, width, channels = self.shape
            return channels, height, width
        return self.shape or (1,)

    def kept(self, network: Network) -> Observation:
        """What a replay memory keeps: images at the network's size, everything else as it is."""
        if not self.is_image:
            return self
        height, width, channels = self.shape
        return self.model_copy(update={"shape": (network.height or height, network.width or width, channels)})

    def misfit(self, array: npt.NDArray[Any]) -> str:
        """What of an array of this dtype is not as it should be: its shape, or a number that cannot be; else ""."""
        if array.shape != self.shape:
            return f"of shape {list(array.shape)}"
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            return "that is not finite"
        if self.values is not None and not 0 <= int(array) < self.values:
            return f"of {int(array)}"
        return ""

    def __str__(self) -> str:
        if self.values is not None:
            return f"Discrete({self.values})"
        return f"{self.dtype} {list(self.shape)}"


class Spaces(BaseModel):
    """What the environment of any task shows and takes: all tasks of a scenario have the same."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    observation: Observation
    actions: tuple[str, ...]
    """Their names; the network has one output for each, in this order."""
    channels: tuple[str, ...] | None = None
    """Names of an image's channels, where the environment gives them."""

    def __str__(self) -> str:
        return f"observations {self.observation} and {len(self.actions)} actions"


class Interface(BaseModel):
    """All sizes of a run: the spaces, and the network's tensors in their order."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    spaces: Spaces
    tensors: tuple[tuple[str, tuple[int, ...]], ...]
    head: int
    """So many of the tensors, the last ones, are the head."""

    @property
    def entries(self) -> list[int]:
        """Numbers in each tensor."""
        return [math.prod(shape) for _, shape in self.tensors]


def shipped_build(observation: Observation) -> str:
    """The network that is taken where a scenario names none."""
    return "deepmind" if observation.is_image else "mlp"


def shipped_tensors(network: Network, spaces: Spaces) -> Interface | None:
    """Sizes with a network that ships here, counted without building it; None with any other, or where it cannot be.

    Where convolutions leave nothing of their input, a tensor is empty.
    """
    kept = spaces.observation.kept(network)
    build = network.build or shipped_build(kept)
    if build not in ("mlp", "deepmind") or (build == "deepmind" and len(kept.fed) != 3):
        return None
    tensors: list[tuple[str, tuple[int, ...]]] = []
    place, features = 0, math.prod(kept.fed)
    if build == "deepmind":
        channels, height, width = kept.fed
        for out, kernel, stride in network.conv:
            tensors += [(f"{place}.weight", (out, channels, kernel, kernel)), (f"{place}.bias", (out,))]
            channels, height, width = out, (height - kernel) // stride + 1, (width - kernel) // stride + 1
            place += 2
        features = channels * max(0, height) * max(0, width)
    place += 1  # the one that flattens
    for size in (*network.dense, len(spaces.actions)):
        tensors += [(f"{place}.weight", (size, features)), (f"{place}.bias", (size,))]
        place, features = place + 2, size
    return Interface(spaces=spaces, tensors=tuple(tensors), head=2)
