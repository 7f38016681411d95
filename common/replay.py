"""Replay memory: frames once, as resized uint8; a transition is a frame and the one after it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from common.errors import RunError, TrainingError
from common.state import State

_KEPT = ("actions", "rewards", "terminated", "complete")


class Batch(NamedTuple):
    """Transitions (x, y, r, x', terminated)."""

    frames: npt.NDArray[np.uint8]  # [batch, height, width, 4]
    actions: npt.NDArray[np.int64]  # [batch]
    rewards: npt.NDArray[np.float32]  # [batch]
    next_frames: npt.NDArray[np.uint8]  # [batch, height, width, 4]; meaningless where terminated
    terminated: npt.NDArray[np.float32]  # [batch], 0 or 1


class Replay:
    """The newest `size` frames in a ring. Call `observe`, `act`, `observe`, `act`, ... in the order of time."""

    def __init__(self, size: int, height: int, width: int, file: Path | None = None) -> None:
        """`file`: where the frames are kept. A round that is done again writes the same frames to the same places, so
        that the frames of the file fit any state since its beginning of that round."""
        self._file, self._is_new = file, file is not None and not file.exists()
        self._frames = _frames(file, (size, height, width, 4))
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

    def state(self) -> State:
        """All but the frames, which must have a file."""
        arrays = {name: getattr(self, f"_{name}") for name in _KEPT}
        return State(arrays, {"written": self._written})

    def load_state(self, state: State) -> None:
        """Go on from a state of this memory and its file.

        Raises:
            RunError: the file has gone.
        """
        if self._is_new and state.values["written"]:
            raise RunError(f"{self._file}: the frames of a replay memory are missing; begin with another --state")
        for name in _KEPT:
            getattr(self, f"_{name}")[:] = state.arrays[name]
        self._written = state.values["written"]

    def sample(self, batch_size: int, rng: np.random.Generator, newest: int | None = None) -> Batch:
        """`batch_size` transitions drawn with replacement, of the `newest` frames only if given.

        Raises:
            TrainingError: there is none.
        """
        slots = np.flatnonzero(self._complete)
        if newest is not None and newest < self._written:
            ages = (self._written - 1 - slots) % len(self._frames)
            slots = slots[ages < newest]
        if not len(slots):
            raise TrainingError(
                f"no motion with the one after it among the newest {newest or len(self._frames)} of {self._written}; "
                "expected one to learn from: collect more (learning.motions_per_round) or keep more (replay_size)"
            )
        chosen = slots[rng.integers(len(slots), size=batch_size)]
        return Batch(
            self._frames[chosen],
            self._actions[chosen],
            self._rewards[chosen],
            self._frames[(chosen + 1) % len(self._frames)],
            self._terminated[chosen],
        )


def _frames(file: Path | None, shape: tuple[int, ...]) -> npt.NDArray[np.uint8]:
    if file is None:
        return np.zeros(shape, np.uint8)
    size = int(np.prod(shape))
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("a+b") as held:
        held.truncate(size)  # zeros at first; of a file of this size nothing is changed
    return np.memmap(file, np.uint8, "r+", shape=shape)
