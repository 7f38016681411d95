"""Replay memory: each observation once, as it is kept; a transition is a frame and the one after it."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jouleswarm.common.disk.seals import Seal
from jouleswarm.common.disk.state import State
from jouleswarm.common.disk.trouble import allocate
from jouleswarm.common.errors import TrainingError
from jouleswarm.common.scenario.spaces import Observation

_KEPT = ("actions", "rewards", "terminated", "complete")


class Batch(NamedTuple):
    """Transitions (x, y, r, x', terminated)."""

    frames: npt.NDArray[Any]  # [batch, *shape], of whatever dtype is kept
    actions: npt.NDArray[np.int64]  # [batch]
    rewards: npt.NDArray[np.float32]  # [batch]
    next_frames: npt.NDArray[Any]  # as frames; meaningless where terminated
    terminated: npt.NDArray[np.float32]  # [batch], 0 or 1


class Replay:
    """The newest `size` frames in a ring. Call `observe`, `act`, `observe`, `act`, ... in the order of time.

    With a file the frames outlive the process, and go with a state of the others. The ring in the file is longer than
    the memory by at least what is observed from one state to the next: frame f is at place f % (size + spare), and
    pushes out frame f - size - spare, which no state remembers that is not older than the newest whole one. So at any
    moment, in the middle of a round or of writing its state, all frames of the newest whole state are in the file as
    they were. The state holds a checksum of each (see `common.disk.seals`), and is refused where one does not fit.
    """

    def __init__(self, size: int, keeps: Observation, file: Path | None = None, spare: int = 0) -> None:
        """
        Args:
            size: frames that are remembered.
            keeps: shape and dtype of a frame.
            file: where the frames are kept.
            spare: frames that may be observed from one state to the next.
        """
        self._file, self._size = file, size
        self._frames = _frames(file, (size + (spare if file else 0), *keeps.shape), np.dtype(keeps.dtype))
        self._checksums = np.zeros(len(self._frames), np.uint32)
        self._actions = np.zeros(size, np.int64)
        self._rewards = np.zeros(size, np.float32)
        self._terminated = np.zeros(size, np.float32)
        # An episode that was truncated ends in a frame without an action: no transition starts there.
        self._complete = np.zeros(size, np.bool_)
        self._written = 0

    def __len__(self) -> int:
        """Number of whole transitions."""
        return int(self._complete.sum())

    def observe(self, frame: npt.NDArray[Any], *, first: bool) -> None:
        """An observation as it is kept; `first` where it opens an episode."""
        slot, last = self._written % self._size, (self._written - 1) % self._size
        if self._written and not first:
            self._complete[last] = True
        place = self._written % len(self._frames)
        self._frames[place] = frame
        if self._file is not None:
            self._checksums[place] = zlib.crc32(self._frames[place])
        self._complete[slot] = False
        self._written += 1

    def act(self, action: int, reward: float, *, terminated: bool) -> None:
        """What was done on the newest frame, and what it brought."""
        last = (self._written - 1) % self._size
        self._actions[last] = action
        self._rewards[last] = reward
        self._terminated[last] = terminated
        self._complete[last] = terminated

    def state(self) -> State:
        """All but the frames, which must have a file; of them the checksums."""
        arrays = {name: getattr(self, f"_{name}") for name in _KEPT}
        return State(arrays, {"written": self._written}, self._seal())

    def load_state(self, state: State) -> None:
        """Go on from a state of this memory, whose file has been found to be as it was."""
        for name in _KEPT:
            getattr(self, f"_{name}")[:] = state.arrays[name]
        self._written = state.values["written"]
        for name, seal in state.files.items():
            if self._file is not None and name == self._file.name:
                self._checksums[self._places()] = seal.checksums

    def sample(self, batch_size: int, rng: np.random.Generator, newest: int | None = None) -> Batch:
        """`batch_size` transitions drawn with replacement, of the `newest` frames only if given.

        Raises:
            TrainingError: there is none.
        """
        slots = np.flatnonzero(self._complete)
        if newest is not None and newest < self._written:
            slots = slots[self._ages(slots) < newest]
        if not len(slots):
            raise TrainingError(
                f"no motion with the one after it among the newest {newest or self._size} of {self._written}; "
                "expected one to learn from: collect more (learning.motions_per_round) or keep more (replay_size)"
            )
        chosen = slots[rng.integers(len(slots), size=batch_size)]
        return Batch(
            self._frames[self._place(chosen)],
            self._actions[chosen],
            self._rewards[chosen],
            self._frames[self._place((chosen + 1) % self._size)],
            self._terminated[chosen],
        )

    def _ages(self, slots: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """How many frames have come since those of the slots."""
        return (self._written - 1 - slots) % self._size

    def _place(self, slots: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Where in the longer ring the frames of the slots are."""
        return (self._written - 1 - self._ages(slots)) % len(self._frames)

    def _places(self) -> npt.NDArray[np.int64]:
        """Of all frames that are remembered, in the order of time."""
        return np.arange(max(0, self._written - self._size), self._written) % len(self._frames)

    def _seal(self) -> dict[str, Seal]:
        if self._file is None:
            return {}
        places, frame_bytes = self._places(), self._frames[0].nbytes
        first = int(places[0]) if len(places) else 0
        return {self._file.name: Seal(frame_bytes, self._checksums[places], first, len(self._frames))}


def _frames(file: Path | None, shape: tuple[int, ...], dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    if file is None:
        return np.zeros(shape, dtype)
    allocate(file, int(np.prod(shape)) * dtype.itemsize)
    return np.memmap(file, dtype, "r+", shape=shape)
