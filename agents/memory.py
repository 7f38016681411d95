"""What a robot remembers on disk of the arm that it is in: enough to go on from the last whole round, bit by bit."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from jouleswarm.common.disk.checkpoint import States, clear, owner_of, place_of
from jouleswarm.common.disk.state import STATE_FILE, Keep, State, Stateful
from jouleswarm.common.disk.verify import ROWS
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase, Weights

_FRAMES, _END = "frames", "end-"


class Memory(States):
    """One state, replaced at the end of each round, and how each arm ended where that is kept.

    A round is on disk before the next one's weights go out, so that neighbours, who keep a round for who asks again,
    have what the robot needs when it comes back.
    """

    def __init__(self, scenario: Scenario, agent: int, run: str, keep: Keep, meter: Meter) -> None:
        super().__init__(keep.folder, owner_of(scenario, run, agent), durable=keep.durable)
        self._keep, self._meter, self._limits = keep, meter, scenario.federation
        # Before a row of an arm's learning a state is saved.
        self._state = self.get(STATE_FILE, lambda row: row["phase"] == RowPhase.FL)

    @property
    def rows(self) -> Path | None:
        """File for the rows of the run log."""
        return self.folder / ROWS if self.folder else None

    def frames(self, arm: str) -> Path | None:
        """File for the frames of an arm's replay memory; all have the same one, unless how they end is kept."""
        return self.folder and self.folder / (f"{_FRAMES}-{arm}.bin" if self._keep.ends else f"{_FRAMES}.bin")

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
        self._save(STATE_FILE, arm, 0, {"start": State(dict(weights))})

    def save(self, arm: str, round_: int, kept: Mapping[str, Stateful], *, ended: bool = False) -> None:
        """The robot has done `round_`."""
        self._save(STATE_FILE, arm, round_, {"start": State(), **kept}, ended=ended)

    @property
    def is_done(self) -> bool:
        """Whether the robot was done with all arms, and nobody needs it any more."""
        return "done" in self._place

    def finish(self) -> None:
        """The robot is done. Its rows and models are kept until the whole run is recorded."""
        self.put(STATE_FILE, {"done": datetime.datetime.now().astimezone().isoformat(" ", "seconds")}, {})

    @property
    def done_line(self) -> str:
        """For who starts a robot that is done."""
        return (
            f"done since {self._place['done']}: handing in again what it has learned; to learn anew delete "
            f"{self.folder} or name another --run"
        )

    def restore(self, arm: str, kept: Mapping[str, Stateful]) -> int:
        """Bring `kept` to where `save` left it; the round, 0 if none had been done."""
        found = self._state if self._is_in(arm) else self._end(arm)
        if found is None or not kept.keys() <= found.values.keys():  # the arm was begun, and no more
            return 0
        found.into(kept)
        return int(place_of(found)["round"])

    @property
    def keeps_ends(self) -> bool:
        """Whether how arms end is kept."""
        return self.folder is not None and self._keep.ends

    def save_end(self, row: RoundRow, kept: Mapping[str, Stateful]) -> None:
        """An arm ends with this row, if only because that is all rounds that there are."""
        if self.keeps_ends:
            self._save(_END + row.arm, row.arm, row.round, {"end": State(values=row.model_dump(mode="json")), **kept})

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
        if self.folder is not None and not self._keep.at_the_end:
            clear(self.folder, f"{STATE_FILE}.[01]", f"{_END}*.[01]", f"{_FRAMES}*.bin")

    def _is_in(self, arm: str) -> bool:
        return bool(self._place.get("arm") == arm)

    @property
    def _place(self) -> dict[str, Any]:
        return {} if self._state is None else place_of(self._state)

    def _save(
        self, part: str, arm: str, round_: int, states: Mapping[str, State | Stateful], *, ended: bool = False
    ) -> None:
        self.put(part, {"arm": arm, "round": round_, "ended": ended}, states)
        if self._keep.durable:
            self._meter.flush()

    def _end(self, arm: str) -> State | None:
        return self.get(_END + arm) if self.keeps_ends else None
