"""What a robot remembers on disk of the arm that it is in: enough to go on from the last whole round, bit by bit."""

from __future__ import annotations

import contextlib
import datetime
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jouleswarm.common.bus.reporter import HANDED_IN
from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.lock import LOCK
from jouleswarm.common.disk.seals import Growing
from jouleswarm.common.disk.state import STATE_FILE, Keep, State, StateFile, Stateful
from jouleswarm.common.errors import RunError
from jouleswarm.common.host import PROCESSOR
from jouleswarm.common.meter.counters import KEYS
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.types import Weights

_ROWS, _FRAMES = "rounds.jsonl", "frames.bin"
_OWN_FILES = (f"{STATE_FILE}.[01]", _ROWS, _FRAMES, "counters*", f"*{HANDED_IN}", PROCESSOR, LOCK)


class Memory:
    """One state, replaced at the end of each round; without a folder nothing is remembered.

    A round is on disk before the next one's weights go out, so that neighbours, who keep a round for who asks again,
    have what the robot needs when it comes back. The rows and counters beside the state, and the frames, are found as
    they were, or the state is refused.
    """

    def __init__(self, scenario: Scenario, agent: int, run: str, keep: Keep, meter: Meter) -> None:
        folder = keep.folder
        self._folder, self._keep, self._meter = folder, keep, meter
        owner = hashlib.sha256(f"{run} {agent} {scenario.determines}".encode()).hexdigest()
        self._file = None
        self._growing: dict[str, Growing] = {}
        if folder is not None:
            self._file = StateFile(folder / STATE_FILE, owner, self.frames, durable=keep.durable)
            self._growing = {name: Growing(folder / name) for name in (_ROWS, KEYS)}
        self._state = self._file.load() if self._file else None
        if folder is not None and self._state is None and _has_learned(folder / _ROWS):
            raise RunError(f"{folder}: the robot's state is gone, though its rows are there; begin the run anew")

    @property
    def rows(self) -> Path | None:
        """File for the rows of the run log."""
        return self._folder / _ROWS if self._folder else None

    @property
    def frames(self) -> Path | None:
        """File for the frames of the replay memory."""
        return self._folder / _FRAMES if self._folder else None

    def is_past(self, arm: str, arms: tuple[str, ...]) -> bool:
        """Whether the robot was in an arm after `arm` already."""
        return self._state is not None and arms.index(arm) < arms.index(self._place["arm"])

    def start_of(self, arm: str) -> Weights | None:
        """The weights that the robot began `arm` with, if it had."""
        if self._state is None or self._place["arm"] != arm:
            return None
        return self._state.part("start").arrays

    def has_ended(self, arm: str) -> bool:
        """Whether the robot was done with learning in `arm`."""
        return self._state is not None and self._place["arm"] == arm and bool(self._place["ended"])

    def begin(self, arm: str, weights: Weights) -> None:
        """The robot is about to begin an arm."""
        self._write(arm, 0, {"start": State(dict(weights))})

    def save(self, arm: str, round_: int, kept: Mapping[str, Stateful], *, ended: bool = False) -> None:
        """The robot has done `round_`."""
        if self._file is not None:
            states = {name: each.state() for name, each in kept.items()}
            self._write(arm, round_, {"start": State(), **states}, ended=ended)

    @property
    def is_done(self) -> bool:
        """Whether the robot was done with all arms, and nobody needs it any more."""
        return self._state is not None and "done" in self._place

    def finish(self) -> None:
        """The robot is done. Its rows and models are kept until the whole run is recorded."""
        if self._file is not None:
            now = datetime.datetime.now().astimezone().isoformat(" ", "seconds")
            self._file.save(State.of({"place": State(values={"done": now})}))

    @property
    def done_line(self) -> str:
        """For who starts a robot that is done."""
        return (
            f"done since {self._place['done']}: handing in again what it has learned; to learn anew delete "
            f"{self._folder} or name another --run"
        )

    def restore(self, arm: str, kept: Mapping[str, Stateful]) -> int:
        """Bring `kept` to where `save` left it; the round, 0 if none had been done."""
        if self._state is None or self._place["arm"] != arm or not self._place["round"]:
            return 0
        for name, each in kept.items():
            each.load_state(self._state.part(name))
        return int(self._place["round"])

    def clear(self) -> None:
        """The run is over: leave no trace, unless who started this process will see to it."""
        if self._folder is not None and not self._keep.at_the_end:
            for path in (path for own in _OWN_FILES for path in self._folder.glob(own)):
                path.unlink()
            with contextlib.suppress(OSError):  # somebody else's files are in it, or a volume is mounted there
                self._folder.rmdir()

    @property
    def _place(self) -> dict[str, Any]:
        assert self._state is not None
        return self._state.part("place").values

    def _write(self, arm: str, round_: int, parts: Mapping[str, State], *, ended: bool = False) -> None:
        if self._file is None:
            return
        place = State(values={"arm": arm, "round": round_, "ended": ended})
        beside = State(files={name: growing.seal() for name, growing in self._growing.items()})
        self._file.save(State.of({**parts, "place": place, "beside": beside}))
        if self._keep.durable:
            self._meter.flush()


def _has_learned(rows: Path) -> bool:
    """Whether there is a row of an arm's learning, before which a state is saved."""
    return any(b'"phase":"fl"' in line for line in whole_lines(rows, mend=False))
