"""From a run's facts (rounds and bytes) to what is priced, arm by arm. Pure; no files, no prices.

Arms of one meta-learning method share its stage: rows and uplink bytes are booked under the method's own name, and
each arm that starts from an earlier meta-model is charged for the rounds up to it. `lost` is what was computed and is
in no row (see `runs.lost_work`): it was paid for as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean

from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.scenario.arms import method_of, snapshot_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.facts import Counts
from jouleswarm.runs.learned import is_learned, missed_exits, rounds_by
from jouleswarm.runs.lost_work import lost_counts
from jouleswarm.runs.traffic import Measure, sent_bytes, traffic


@dataclass(frozen=True)
class TaskResult:
    """How one task went in one arm."""

    task: int
    rounds: int  # t_i; 0: learned before the first round; where robots stop by themselves, of the last one
    reward: float | None  # the cluster's running reward R after them; the mean of theirs where each has its own
    rmse_m: float | None
    learned: bool
    robot_rounds: int  # summed over the robots
    full_window: int | None = None  # t_i by the measures of `runs.learned`; None: not by then
    partial_window: int | None = None
    missed_exits: int | None = None  # of the `episodes` that R is of; None where no end is told
    episodes: int = 0


def meta_counts(
    rows: Iterable[RoundRow],
    meter_rows: Sequence[MeterRow],
    arm: str,
    *,
    measure: Measure = "payload",
    lost: Sequence[WorkRow] = (),
) -> Counts:
    """What the meta-learning behind an arm computed and moved, up to the round that the arm starts from.

    The downlink is the arm's own; lost work is spread over the rounds as the uplink is. Nothing for methods without
    meta-learning.
    """
    method = method_of(arm)
    stage = [row for row in rows if row.arm == method and row.phase == RowPhase.ML]
    part, whole = _uplink_share(stage, snapshot_of(arm))
    uplink_bytes = getattr(traffic(meter_rows, method, Link.UPLINK, phase=RowPhase.ML), measure)
    behind = [row for row in stage if row.round <= (snapshot_of(arm) or row.round)]
    wasted = lost_counts((row for row in lost if (row.phase, row.arm) == (RowPhase.ML, method)), part / whole)
    return (
        gradient_counts(behind)
        + wasted
        + Counts(
            uplink_bytes=uplink_bytes * part / whole,
            downlink_bytes=getattr(traffic(meter_rows, arm, Link.DOWNLINK, phase=RowPhase.ML), measure),
        )
    )


def stage_share(rows: Iterable[RoundRow], arm: str) -> float:
    """The arm's part of what carried and computed the phase ml that it shares with others; 1 where it shares none."""
    stage = [row for row in rows if (row.arm, row.phase) == (method_of(arm), RowPhase.ML)]
    part, whole = _uplink_share(stage, snapshot_of(arm))
    return part / whole


def task_counts(
    rows: Iterable[RoundRow],
    meter_rows: Sequence[MeterRow],
    arm: str,
    *,
    task: int | None = None,
    measure: Measure = "payload",
    lost: Sequence[WorkRow] = (),
) -> Counts:
    """What an arm's learning of `task` (default: of all tasks) computed and moved, meta-learning left out.

    In the methods in which the data center serves every round, that is its gradients, uplink and downlink as well.
    """
    mine = [row for row in rows if row.arm == arm and row.phase == RowPhase.FL and task in (None, row.task)]
    links = (Link.UPLINK, Link.DOWNLINK, Link.SIDELINK)
    moved = {link: getattr(traffic(meter_rows, arm, link, task, phase=RowPhase.FL), measure) for link in links}
    wasted = lost_counts(row for row in lost if (row.phase, row.arm) == (RowPhase.FL, arm) and task in (None, row.task))
    return (
        gradient_counts(mine)
        + wasted
        + Counts(
            uplink_bytes=moved[Link.UPLINK],
            downlink_bytes=moved[Link.DOWNLINK],
            sidelink_bytes=moved[Link.SIDELINK],
            sidelink_sent_bytes=sent_bytes(meter_rows, arm, task, measure),
        )
    )


def meta_rounds(rows: Iterable[RoundRow], arm: str) -> int:
    """t0: rounds of meta-learning done behind an arm's model; 0 for methods without."""
    method, snapshot = method_of(arm), snapshot_of(arm)
    done = max((row.round for row in rows if (row.arm, row.agent, row.phase) == (method, 0, RowPhase.ML)), default=0)
    return done if snapshot is None else min(done, snapshot)


def task_results(
    scenario: Scenario, rows: Iterable[RoundRow], arm: str, tasks: Iterable[int] | None = None
) -> list[TaskResult]:
    """How each task (default: all of the scenario) went in an arm; rounds are numbered from 1."""
    mine = [row for row in rows if row.arm == arm and row.phase == RowPhase.FL and row.agent != 0]
    partners = scenario.method(method_of(arm)).partners
    return [
        _result(scenario, task, [row for row in mine if row.task == task], partners)
        for task in (tasks if tasks is not None else scenario.clusters)
    ]


def zero_shot_share(results: Sequence[TaskResult]) -> float:
    """Share of an arm's tasks that were learned before their first round."""
    return fmean(result.learned and not result.rounds for result in results)


def path_error(results: Sequence[TaskResult]) -> tuple[float, float] | None:
    """RMSE in metres at the end of an arm's tasks: their mean, and that of the worst task.

    Of each task it is the mean over its robots, as `TaskResult.rmse_m`. None where no task has a path.
    """
    errors_m = [result.rmse_m for result in results if result.rmse_m is not None]
    return (fmean(errors_m), max(errors_m)) if errors_m else None


def gradient_counts(rows: Iterable[RoundRow]) -> Counts:
    """Batch gradients by where they were computed."""
    rows = list(rows)
    center = [row for row in rows if row.agent == 0]
    return Counts(
        gradients_support=sum(row.gradients - (row.gradients_query or 0) for row in center),
        gradients_query=sum(row.gradients_query or 0 for row in center),
        gradients_robots=sum(row.gradients for row in rows if row.agent != 0),
    )


def _uplink_share(stage: list[RoundRow], snapshot: int | None) -> tuple[int, int]:
    """Which part of the stage's uplink carried the rounds up to `snapshot`: (part, whole), by bytes or by rounds.

    Exact by bytes where nothing was sent twice: repetitions are spread over all rounds.
    """
    center = [row for row in stage if row.agent == 0]
    last = max((row.round for row in center), default=0)
    if snapshot is None or last <= snapshot:
        return 1, 1
    whole = sum(row.experience_bytes or 0 for row in center)
    if whole == 0 or any(row.experience_bytes is None for row in center):
        return snapshot, last
    return sum(row.experience_bytes or 0 for row in center if row.round <= snapshot), whole


def _result(scenario: Scenario, task: int, rows: list[RoundRow], partners: str) -> TaskResult:
    newest: dict[int, RoundRow] = {}
    settings, alone = scenario.federation, partners == "nobody"
    for row in sorted(rows, key=lambda row: row.round):
        newest[row.agent] = row
    rounds = max((row.round for row in newest.values()), default=0)
    # A cluster stops as one: a robot that is behind was cut off, its last row says nothing about the end.
    last = [row for row in newest.values() if alone or row.round == rounds]
    rewards = [row.cluster_reward for row in last if row.cluster_reward is not None]
    errors_m = [row.rmse_m for row in last if row.rmse_m is not None]
    missed, episodes = missed_exits(settings, rows, newest)
    everybody = len(last) == len(scenario.cluster(task)) or not alone
    return TaskResult(
        task=task,
        rounds=rounds,
        reward=fmean(rewards) if rewards else None,
        rmse_m=fmean(errors_m) if errors_m else None,
        learned=bool(last) and everybody and all(is_learned(settings, row) for row in last),
        robot_rounds=sum(row.round for row in newest.values()),
        full_window=rounds_by(scenario, rows, partners, full=True),
        partial_window=rounds_by(scenario, rows, partners, full=False),
        missed_exits=missed if episodes else None,
        episodes=episodes,
    )
