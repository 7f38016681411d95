"""Replay memory: frames once, as resized uint8; a transition is a frame and the one after it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt


class Batch(NamedTuple):
    """Transitions (x, y, r, x', terminated)."""

    frames: npt.NDArray[np.uint8]  # [batch, height, width, 4]
    actions: npt.NDArray[np.int64]  # [batch]
    rewards: npt.NDArray[np.float32]  # [batch]
    next_frames: npt.NDArray[np.uint8]  # [batch, height, width, 4]; meaningless where terminated
    terminated: npt.NDArray[np.float32]  # [batch], 0 or 1


class Replay:
    """The newest `size` frames in a ring. Call `observe`, `act`, `observe`, `act`, ... in the order of time."""

    def __init__(self, size: int, height: int, width: int) -> None:
        self._frames = np.zeros((size, height, width, 4), np.uint8)
        self._actions = np.zeros(size, np.int64)
        self._rewards = np.zeros(size, np.float32)
        self._terminated = np.zeros(size, np.float32)
        # An episode that was truncated ends in a frame without an action: no transition starts there.
        self._complete = np.zeros(size, np.bool_)
        self._written = 0

    def __len__(self) -> int:
        """Number of whole transitions."""
        return int(self._complete.sum())

    def observe(self, frame: npt.NDArray[np.uint8], *, first: bool) -> None:
        """A resized frame [height, width, 4]; `first` where it opens an episode."""
        slot, last = self._written % len(self._frames), (self._written - 1) % len(self._frames)
        if self._written and not first:
            self._complete[last] = True
        self._frames[slot] = frame
        self._complete[slot] = False
        self._written += 1

    def act(self, action: int, reward: float, *, terminated: bool) -> None:
        """What was done on the newest frame, and what it brought."""
        last = (self._written - 1) % len(self._frames)
        self._actions[last] = action
        self._rewards[last] = reward
        self._terminated[last] = terminated
        self._complete[last] = terminated

    def sample(self, batch_size: int, rng: np.random.Generator, newest: int | None = None) -> Batch:
        """`batch_size` transitions drawn with replacement, of the `newest` frames only if given."""
        slots = np.flatnonzero(self._complete)
        if newest is not None and newest < self._written:
            ages = (self._written - 1 - slots) % len(self._frames)
            slots = slots[ages < newest]
        chosen = slots[rng.integers(len(slots), size=batch_size)]
        return Batch(
            self._frames[chosen],
            self._actions[chosen],
            self._rewards[chosen],
            self._frames[(chosen + 1) % len(self._frames)],
            self._terminated[chosen],
        )
