"""A run as series over rounds, for programs that draw such: R, rewards, joules, bits. The same names while it goes on
(`Growing`) and afterwards (`scalars`)."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Mapping
from typing import NamedTuple, Protocol

from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.bill import PAPER_CAUSES, Cost
from jouleswarm.energy.curves import until
from jouleswarm.energy.facts import BITS_PER_BYTE, Counts, Facts, Phase
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.runs.curves import SPENT, curves
from jouleswarm.runs.directory import TIMES
from jouleswarm.runs.run import Run


class Scalar(NamedTuple):
    """One value of a series of an arm."""

    name: str
    value: float
    round: int
    time_s: float
    """Since 1970: when the round's last row came; of a run without times 0."""


class Spent(Protocol):
    """What has been done so far; the recorder knows."""

    @property
    def counts(self) -> Mapping[tuple[str, Phase], Counts]:
        """By arm and phase."""

    def cost(self, arm: str, phase: Phase) -> Cost | None:
        """Joules; None where they are told at the end only."""


class Heard(Protocol):
    """What is known of a run while it goes on; the recorder is one who knows."""

    @property
    def run(self) -> str:
        """Its name."""

    @property
    def spent(self) -> Spent:
        """What has been done so far."""


class Growing:
    """The series of a run that goes on, as far as it has come."""

    def __init__(self, scenario: Scenario, spent: Spent) -> None:
        self._scenario, self._spent = scenario, spent
        self._rounds: dict[tuple[str, str], int] = {}

    def take(self, row: RoundRow) -> Iterator[tuple[str, Scalar]]:
        """(arm, value): what a new row tells; with the first of an arm's next round what the rounds before took, as
        `spent/joules` and the like, or `stage/joules` of the stage's own."""
        now_s, is_stage = time.time(), row.phase == RowPhase.ML
        arms = [arm.name for arm in self._scenario.arms if arm.method == row.arm and row.round <= arm.t0]
        for arm in arms if is_stage else [row.arm]:
            before = self._rounds.get((arm, row.phase))
            self._rounds[arm, row.phase] = row.round if before is None else max(before, row.round)
            if not is_stage and before is None and (last := self._rounds.get((arm, RowPhase.ML))) is not None:
                yield from ((arm, each) for each in self._point(arm, last, now_s, is_stage=True))
            if before is not None and row.round > before:
                yield from ((arm, each) for each in self._point(arm, before, now_s, is_stage=is_stage))
            yield from ((arm, each) for each in _of_row(self._scenario, row, now_s))

    def end(self, run: Run) -> Iterator[tuple[str, Scalar]]:
        """The last rounds' points, and the bill, as they were counted in the end."""
        now_s = time.time()
        for arm in run.scenario.arm_names:
            facts, cost = run.facts[arm], _cost(run, run.facts[arm])
            round_ = max((result.rounds for result in run.results[arm]), default=0)
            for name, value in (*_spending(facts.counts.ml + facts.counts.fl, cost), *_bill(cost)):
                yield arm, Scalar(name, value, round_, now_s)

    def _point(self, arm: str, round_: int, time_s: float, *, is_stage: bool) -> Iterator[Scalar]:
        phases: tuple[Phase, ...] = ("ml",) if is_stage else ("ml", "fl")
        costs = [self._spent.cost(arm, phase) for phase in phases]
        known = [cost for cost in costs if cost is not None]
        counts = sum((self._spent.counts.get((arm, phase), Counts()) for phase in phases), Counts())
        cost = sum(known, Cost()) if len(known) == len(costs) else None
        for name, value in _spending(counts, cost):
            yield Scalar(f"stage/{name.removeprefix('spent/')}" if is_stage else name, value, round_, time_s)


def scalars(run: Run, arm: str) -> Iterator[Scalar]:
    """`R/task-1`, `reward/robot-3`, `gradients/robot-3` by round of the tasks, `spent/joules` and the like of the
    whole arm, its stage before included, `joules/uplink` and the like, and its bill, `bill/joules`, `bill/uplink`."""
    times = _times(run, arm)
    for row in run.rows:
        if row.arm == arm:
            yield from _of_row(run.scenario, row, times.get(row.round, 0.0))
    points = curves(run, run.scenario.energy)
    last = 0
    for point in points[points["arm"] == arm].to_dict("records"):
        last = int(point["round"])
        for name in (*SPENT, "share_learned"):
            value = point[name]
            if value is not None and math.isfinite(value):
                yield Scalar(f"spent/{name}" if name in SPENT else name, float(value), last, times.get(last, 0.0))
    facts = run.facts[arm]
    for round_ in range(last + 1):
        for name, value in _by_cause("joules", _cost(run, until(facts, round_))):
            yield Scalar(name, value, round_, times.get(round_, 0.0))
    for name, value in _bill(_cost(run, facts)):
        yield Scalar(name, value, last, times.get(last, 0.0))


def _cost(run: Run, facts: Facts) -> Cost | None:
    """At the equations' prices; None where no bytes were counted."""
    bill = price(literal, facts, run.scenario.energy) if facts.metered else None
    return None if bill is None else bill.both


def _bill(cost: Cost | None) -> Iterator[tuple[str, float]]:
    if cost is not None:
        yield "bill/joules", cost.total_j
    yield from _by_cause("bill", cost)


def _by_cause(what: str, cost: Cost | None) -> Iterator[tuple[str, float]]:
    for cause, joules in () if cost is None else cost.by_cause.items():
        if joules or cause in PAPER_CAUSES:
            yield f"{what}/{cause.key}", joules


def _of_row(scenario: Scenario, row: RoundRow, time_s: float) -> Iterator[Scalar]:
    if row.phase != RowPhase.FL or not row.agent:
        return
    if row.agent == scenario.cluster(row.task)[0]:
        if row.cluster_reward is not None:
            yield Scalar(f"R/task-{row.task}", row.cluster_reward, row.round, time_s)
        if row.learned is not None:
            yield Scalar(f"learned/task-{row.task}", float(row.learned), row.round, time_s)
    robot = f"robot-{row.agent}"
    if row.reward is not None:
        yield Scalar(f"reward/{robot}", row.reward, row.round, time_s)
    yield Scalar(f"gradients/{robot}", float(row.gradients), row.round, time_s)


def _spending(counts: Counts, cost: Cost | None) -> Iterator[tuple[str, float]]:
    moved = counts.uplink_bytes + counts.downlink_bytes + counts.sidelink_bytes
    yield "spent/bits", BITS_PER_BYTE * moved
    yield "spent/gradients", counts.gradients_support + counts.gradients_query + counts.gradients_robots
    if cost is not None:
        yield "spent/joules", cost.total_j
    yield from _by_cause("joules", cost)


def _times(run: Run, arm: str) -> dict[int, float]:
    found: dict[int, float] = {}
    for line in whole_lines(run.path / TIMES, mend=False):
        row = json.loads(line)
        if (row["arm"], row["phase"]) == (arm, RowPhase.FL):
            found[row["round"]] = max(found.get(row["round"], 0.0), row["time_s"])
    return found
