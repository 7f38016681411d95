"""What a robot remembers on disk of the arm that it is in: enough to go on from the last whole round, bit by bit."""

from __future__ import annotations

import contextlib
import datetime
import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from jouleswarm.common.bus.reporter import HANDED_IN
from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.lock import LOCK
from jouleswarm.common.disk.seals import Growing
from jouleswarm.common.disk.state import STATE_FILE, Keep, State, Stateful
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import RunError
from jouleswarm.common.host import PROCESSOR
from jouleswarm.common.meter.counters import KEYS
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import Weights

_ROWS, _FRAMES, _END = "rounds.jsonl", "frames", "end-"
_OWN_FILES = (
    *(f"{STATE_FILE}.[01]", f"{_END}*.[01]", f"{_FRAMES}*.bin", _ROWS),
    *("counters*", f"*{HANDED_IN}", PROCESSOR, LOCK),
)


class Memory:
    """One state, replaced at the end of each round; without a folder nothing is remembered.

    A round is on disk before the next one's weights go out, so that neighbours, who keep a round for who asks again,
    have what the robot needs when it comes back. The rows and counters beside the state, and the frames, are found as
    they were, or the state is refused.
    """

    def __init__(self, scenario: Scenario, agent: int, run: str, keep: Keep, meter: Meter) -> None:
        folder = keep.folder
        self._folder, self._keep, self._meter = folder, keep, meter
        self._owner = hashlib.sha256(f"{run} {agent} {scenario.determines}".encode()).hexdigest()
        self._limits = scenario.federation
        self._file = None
        self._growing: dict[str, Growing] = {}
        if folder is not None:
            self._file = StateFile(folder / STATE_FILE, self._owner, durable=keep.durable)
            self._growing = {name: Growing(folder / name) for name in (_ROWS, KEYS)}
        self._state = self._file.load() if self._file else None
        if folder is not None and self._state is None and _has_learned(folder / _ROWS):
            raise RunError(f"{folder}: the robot's state is gone, though its rows are there; begin the run anew")

    @property
    def rows(self) -> Path | None:
        """File for the rows of the run log."""
        return self._folder / _ROWS if self._folder else None

    def frames(self, arm: str) -> Path | None:
        """File for the frames of an arm's replay memory; all have the same one, unless how they end is kept."""
        return (
            self._folder / (f"{_FRAMES}-{arm}.bin" if self._keep.ends else f"{_FRAMES}.bin") if self._folder else None
        )

    def is_past(self, arm: str, arms: tuple[str, ...]) -> bool:
        """Whether the robot was in an arm after `arm` already."""
        return self._state is not None and arms.index(arm) < arms.index(self._place["arm"])

    def start_of(self, arm: str) -> Weights | None:
        """The weights that the robot began `arm` with, if it had."""
        return self._state.part("start").arrays if self._state is not None and self._is_in(arm) else None

    def has_ended(self, arm: str) -> bool:
        """Whether the robot was done with learning in `arm`."""
        return self._is_in(arm) and bool(self._place["ended"])

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
        found = self._state if self._is_in(arm) else self._end(arm)
        if found is None or not kept.keys() <= found.values.keys():  # the arm was begun, and no more
            return 0
        round_ = found.part("place").values["round"]
        for name, each in kept.items():
            each.load_state(found.part(name))
        return int(round_)

    @property
    def keeps_ends(self) -> bool:
        """Whether how arms end is kept."""
        return self._folder is not None and self._keep.ends

    def save_end(self, row: RoundRow, kept: Mapping[str, Stateful]) -> None:
        """An arm ends with this row, if only because that is all rounds that there are."""
        if (file := self._end_file(row.arm)) is not None:
            states = {name: each.state() for name, each in kept.items()}
            end = State(values=row.model_dump(mode="json"))
            self._put(file, row.arm, row.round, {"end": end, **states})

    def end_of(self, arm: str) -> RoundRow | None:
        """The row that the robot ended `arm` with in a run of fewer rounds, or one that it has not begun again."""
        found = None if self._is_in(arm) else self._end(arm)
        return None if found is None else RoundRow.model_validate(found.part("end").values)

    def is_over(self, end: RoundRow) -> bool:
        """Whether an arm that ended with this row would end there by the scenario as it is now."""
        return end.is_over(self._limits.max_rounds, self._limits.target_reward)

    def begin_again(self, arms: Iterable[str]) -> bool:
        """Whether a robot that was done is not, for one of its arms has more rounds now."""
        if not self.is_done:
            return False
        self._state, done = None, self._state
        ends = [end for arm in arms if (end := self.end_of(arm)) is not None]
        if all(map(self.is_over, ends)):
            self._state = done
        return self._state is None

    def clear(self) -> None:
        """The run is over: leave no trace, unless who started this process will see to it."""
        if self._folder is not None and not self._keep.at_the_end:
            for path in (path for own in _OWN_FILES for path in self._folder.glob(own)):
                path.unlink()
            with contextlib.suppress(OSError):  # somebody else's files are in it, or a volume is mounted there
                self._folder.rmdir()

    def _is_in(self, arm: str) -> bool:
        return self._state is not None and bool(self._place["arm"] == arm)

    @property
    def _place(self) -> dict[str, Any]:
        assert self._state is not None
        return self._state.part("place").values

    def _write(self, arm: str, round_: int, parts: Mapping[str, State], *, ended: bool = False) -> None:
        if self._file is not None:
            self._put(self._file, arm, round_, parts, ended=ended)

    def _put(self, file: StateFile, arm: str, round_: int, parts: Mapping[str, State], *, ended: bool = False) -> None:
        place = State(values={"arm": arm, "round": round_, "ended": ended})
        beside = State(files={name: growing.seal() for name, growing in self._growing.items()})
        file.frames = self.frames(arm)
        file.save(State.of({**parts, "place": place, "beside": beside}))
        if self._keep.durable:
            self._meter.flush()

    def _end_file(self, arm: str) -> StateFile | None:
        if self._folder is None or not self._keep.ends:
            return None
        return StateFile(self._folder / f"{_END}{arm}", self._owner, durable=self._keep.durable)

    def _end(self, arm: str) -> State | None:
        file = self._end_file(arm)
        return None if file is None else file.load()


def _has_learned(rows: Path) -> bool:
    """Whether there is a row of an arm's learning, before which a state is saved."""
    return any(b'"phase":"fl"' in line for line in whole_lines(rows, mend=False))
