"""From a run's facts (rounds and bytes) to what is priced and to `summary.json`. Pure; no files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any, Literal

from common import topics
from common.energy import Bill, Counts, PublishedBill, bill, published_bill
from common.meter import MeterRow
from common.runlog import RoundRow
from common.scenario import Scenario
from common.topics import Link
from fleet.traffic import Measure, metered_by, sent_bytes, traffic


@dataclass(frozen=True)
class TaskResult:
    """How one task went in one arm."""

    task: int
    rounds: int  # t_i
    reward: float | None  # the cluster's running reward R after them
    rmse_m: float | None
    learned: bool


def counts(
    rows: Iterable[RoundRow],
    meter_rows: Sequence[MeterRow],
    arm: str,
    *,
    task: int | None = None,
    measure: Measure = "payload",
) -> Counts:
    """What an arm (or one task's federated stage of it) computed and moved.

    With `task`, the data center's work and the uplink are left out: they serve all tasks.
    """
    mine = [row for row in rows if row.arm == arm and task in (None, row.task)]
    center = [row for row in mine if row.agent == 0 and task is None]
    side_bytes = getattr(traffic(meter_rows, arm, Link.SIDELINK, task), measure)
    shared = {
        link: 0 if task is not None else getattr(traffic(meter_rows, arm, link), measure)
        for link in (Link.UPLINK, Link.DOWNLINK)
    }
    return Counts(
        gradients_support=sum(row.gradients - (row.gradients_query or 0) for row in center),
        gradients_query=sum(row.gradients_query or 0 for row in center),
        gradients_robots=sum(row.gradients for row in mine if row.agent != 0),
        uplink_bytes=shared[Link.UPLINK],
        downlink_bytes=shared[Link.DOWNLINK],
        sidelink_bytes=side_bytes,
        sidelink_sent_bytes=sent_bytes(meter_rows, arm, task, measure),
    )


def maml_rounds(rows: Iterable[RoundRow]) -> int:
    """t0: MAML rounds that the data center finished."""
    return max((row.round for row in rows if row.agent == 0 and row.phase == "maml"), default=0)


def task_results(
    scenario: Scenario, rows: Iterable[RoundRow], arm: str, tasks: Iterable[int] | None = None
) -> list[TaskResult]:
    """How each task (default: all of the scenario) went in an arm; rounds are numbered from 1."""
    mine = [row for row in rows if row.arm == arm and row.phase == "fl" and row.agent != 0]
    return [
        _result(task, [row for row in mine if row.task == task], scenario.federation.target_reward)
        for task in (tasks if tasks is not None else scenario.clusters)
    ]


def summarise(
    scenario: Scenario,
    rows: Sequence[RoundRow],
    meter_rows: Sequence[MeterRow],
    tasks: Iterable[int] | None = None,
    *,
    status: Literal["complete", "interrupted", "failed"] = "complete",
) -> dict[str, Any]:
    """`summary.json` of a run, as plain data.

    Joules follow the scenario's own constants. Without any meter row the joules that need bytes are null.
    """
    wanted = list(scenario.clusters if tasks is None else tasks)
    return {
        "seed": scenario.seed,
        "t0": maml_rounds(rows),
        "status": status,
        "metered_by": metered_by(meter_rows),
        "arms": {arm: _arm_summary(scenario, rows, meter_rows, arm, wanted) for arm in scenario.arm_names},
        "shared_control": traffic(meter_rows, topics.SHARED, Link.CONTROL)._asdict(),
    }


def literal_parts(priced: Bill, metered: bool) -> dict[str, float | None]:
    """A literal bill under the names of `summary.json`; unmetered communication is not known, not free."""
    return {
        "ml_learning": priced.ml_learning_j,
        "ml_communication": priced.ml_communication_j if metered else None,
        "fl_learning": priced.fl_learning_j,
        "fl_communication": priced.fl_communication_j if metered else None,
        "total": priced.total_j if metered else None,
    }


def published_parts(priced: PublishedBill | None) -> dict[str, float | None] | None:
    """A published bill under the same names: it has no parts, but nothing is made up of nothing."""
    if priced is None:
        return None
    ml = 0.0 if priced.ml_j == 0 else None
    fl = 0.0 if priced.fl_j == 0 else None
    return {
        "ml_learning": ml,
        "ml_communication": ml,
        "fl_learning": fl,
        "fl_communication": fl,
        "total": priced.total_j,
    }


def _arm_summary(
    scenario: Scenario, rows: Sequence[RoundRow], meter_rows: Sequence[MeterRow], arm: str, tasks: list[int]
) -> dict[str, Any]:
    results = task_results(scenario, rows, arm, tasks)
    t0 = maml_rounds(row for row in rows if row.arm == arm)
    literal = bill(counts(rows, meter_rows, arm), scenario.energy)
    published = published_bill(t0, sum(result.rounds for result in results), scenario.energy)
    return {
        "tasks": [asdict(result) for result in results],
        "energy_j": {
            "literal": literal_parts(literal, metered=bool(meter_rows)),
            "published": published_parts(published),
        },
        "bytes": {link.value: traffic(meter_rows, arm, link)._asdict() for link in Link},
    }


def _result(task: int, rows: list[RoundRow], target_reward: float) -> TaskResult:
    rounds = max((row.round for row in rows), default=0)
    last = [row for row in rows if row.round == rounds]
    rewards = [row.cluster_reward for row in last if row.cluster_reward is not None]
    errors_m = [row.rmse_m for row in last if row.rmse_m is not None]
    flags = [row.learned for row in last if row.learned is not None]
    return TaskResult(
        task=task,
        rounds=rounds,
        reward=fmean(rewards) if rewards else None,
        rmse_m=fmean(errors_m) if errors_m else None,
        learned=all(flags) if flags else bool(rewards) and min(rewards) >= target_reward,
    )
