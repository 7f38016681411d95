"""From a run directory to facts: the only place where a study reads what a run left behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from itertools import groupby
from statistics import fmean

from common.energy import Counts, directed_links
from common.meter import MeterRow
from common.methods import META_METHODS, Arm
from common.runlog import RoundRow
from common.topics import Link
from fleet.pricing import TaskResult, counts
from fleet.report_data import Run
from fleet.traffic import deliveries, traffic
from studies.facts import META_STAGE, Fact

_TASK_LEVEL = 4  # jouleswarm/<run>/<arm>/<link>/<task>/...


def facts_of(run: Run) -> list[Fact]:
    """Reduce a run to one fact an arm and stage: meta-learning first where there is one, then each task.

    Arms that start from one meta-training share it: each is given its first t0 rounds, as if it had been run alone.
    """
    facts = []
    for arm in run.scenario.arms:
        if arm.method in META_METHODS:
            facts.append(_meta_fact(run, arm))
        facts += [_task_fact(run, arm, result) for result in run.results[arm.name]]
    return facts


def first_round(rewards: Sequence[Sequence[float]], target: float, window: int) -> int | None:
    """The first round, from 1, in which the robots' mean reward over the last `window` rounds reaches `target`.

    Args:
        rewards: [round][robot] rewards of greedy episodes; of the first rounds there are fewer than `window`.
        target: the reward at which a task counts as learned.
        window: rounds that are averaged, 1 or more.
    """
    means = [fmean(of_round) for of_round in rewards]
    for round_ in range(1, len(means) + 1):
        if fmean(means[max(0, round_ - window) : round_]) >= target:
            return round_
    return None


def _meta_fact(run: Run, arm: Arm) -> Fact:
    center = [row for row in run.rows if (row.phase, row.arm, row.agent) == ("maml", arm.method, 0)]
    mine = [row for row in center if row.round <= arm.t0]
    query = sum(row.gradients_query or 0 for row in mine)
    found = Counts(
        gradients_support=sum(row.gradients for row in mine) - query,
        gradients_query=query,
        uplink_bytes=traffic(run.meter_rows, arm.method, Link.UPLINK).payload * _share(mine, center),
        downlink_bytes=traffic(run.meter_rows, arm.name, Link.DOWNLINK).payload,
    )
    return Fact(
        **_head(run, arm),
        task=META_STAGE,
        robots=len(run.scenario.agents),
        links=0,
        rounds=arm.t0,
        rounds_first=arm.t0,
        rounds_w3=arm.t0,
        learned=True,
        reward=None,
        rmse_m=None,
        **asdict(found),
        seconds=round(sum(row.seconds for row in mine), 3),
    )


def _share(mine: Sequence[RoundRow], all_rows: Sequence[RoundRow]) -> float:
    """How much of the experience sent up the first rounds were learned from; by rounds where no bytes were told."""
    if not all_rows or len(mine) == len(all_rows):
        return 1.0
    told = [sum(row.experience_bytes or 0 for row in rows) for rows in (mine, all_rows)]
    return told[0] / told[1] if told[1] else len(mine) / len(all_rows)


def _task_fact(run: Run, arm: Arm, result: TaskResult) -> Fact:
    rows = [
        row for row in run.rows if (row.phase, row.arm, row.task) == ("fl", arm.name, result.task) and row.agent != 0
    ]
    rewards = _rewards(rows)
    target = run.scenario.federation.target_reward
    robots = len(run.scenario.cluster(result.task))
    return Fact(
        **_head(run, arm),
        task=result.task,
        robots=robots,
        links=directed_links(robots, run.scenario.federation),
        rounds=result.rounds,
        rounds_first=first_round(rewards, target, 1) or result.rounds,
        rounds_w3=first_round(rewards, target, 3) or result.rounds,
        learned=result.learned,
        reward=result.reward,
        rmse_m=result.rmse_m,
        **asdict(_task_counts(run, arm, result.task)),
        seconds=_slowest_s(rows),
    )


def _task_counts(run: Run, arm: Arm, task: int) -> Counts:
    """What a task's own stage did; where the data center serves every round, its part is the task's too."""
    found = counts(run.rows, run.meter_rows, arm.name, task=task)
    if arm.method in META_METHODS:
        return found
    served = [row for row in run.rows if (row.arm, row.task, row.agent) == (arm.name, task, 0)]
    return found + Counts(
        gradients_support=sum(row.gradients for row in served),
        uplink_bytes=_task_bytes(run.meter_rows, arm.name, Link.UPLINK, task),
        downlink_bytes=_task_bytes(run.meter_rows, arm.name, Link.DOWNLINK, task),
    )


def _task_bytes(meter_rows: Sequence[MeterRow], arm: str, link: Link, task: int) -> int:
    rows = deliveries(meter_rows, arm, link)
    return sum(row.payload_bytes for row in rows if row.topic.split("/")[_TASK_LEVEL] == str(task))


def _rewards(rows: Sequence[RoundRow]) -> list[list[float]]:
    """[round][robot] rewards, in the order of rounds."""
    told = sorted((row.round, row.agent, row.reward) for row in rows if row.reward is not None)
    return [[reward for *_, reward in of_round] for _, of_round in groupby(told, key=lambda row: row[0])]


def _slowest_s(rows: Sequence[RoundRow]) -> float:
    of_robot: dict[int, float] = {}
    for row in rows:
        of_robot[row.agent] = of_robot.get(row.agent, 0.0) + row.seconds
    return round(max(of_robot.values(), default=0.0), 3)


def _head(run: Run, arm: Arm) -> dict[str, str | int]:
    return {"variant": "", "seed": run.scenario.seed, "arm": arm.name, "method": arm.method, "t0": arm.t0}
