"""From a run directory to facts: the only place where a study reads what a run left behind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from statistics import fmean

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.facts import STAGE, Facts, Phase
from jouleswarm.runs.curves import rewards_by_round
from jouleswarm.runs.directory import computed_on
from jouleswarm.runs.facts import TaskResult
from jouleswarm.runs.run import Run
from jouleswarm.studies.facts import META_STAGE, Fact


def facts_of(run: Run) -> list[Fact]:
    """Reduce a run to one fact an arm and stage: meta-learning first where there is one, then each task.

    Arms that start from one meta-training share it: each is given its first t0 rounds, as if it had been run alone.
    """
    facts = []
    for arm in run.scenario.arms:
        if arm.t0:
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
    stage = [row for row in run.rows if (row.phase, row.arm, row.agent) == (RowPhase.ML, arm.method, 0)]
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
        **_counts(run.facts[arm.name], "ml", STAGE),
        beta=run.facts[arm.name].beta,
        seconds=round(sum(row.seconds for row in stage if row.round <= arm.t0), 3),
    )


def _task_fact(run: Run, arm: Arm, result: TaskResult) -> Fact:
    rows = [
        row
        for row in run.rows
        if (row.phase, row.arm, row.task) == (RowPhase.FL, arm.name, result.task) and row.agent != 0
    ]
    rewards = _rewards(rows)
    target = run.scenario.federation.target_reward
    facts = run.facts[arm.name]
    return Fact(
        **_head(run, arm),
        task=result.task,
        robots=facts.robots[result.task],
        links=facts.links[result.task],
        rounds=result.rounds,
        rounds_first=first_round(rewards, target, 1) or result.rounds,
        rounds_w3=first_round(rewards, target, 3) or result.rounds,
        learned=result.learned,
        reward=result.reward,
        rmse_m=result.rmse_m,
        **_counts(facts, "fl", result.task),
        seconds=_slowest_s(rows),
        ran_away=sum(row.ran_away is not None for row in rows),
        rewards=_rewards_text(rewards_by_round(run, arm.name).get(result.task, {})),
    )


def _counts(facts: Facts, phase: Phase, task: int) -> dict[str, float | None]:
    """Sums of a stage, with what its robots' bodies did."""
    mine = [work for work in facts.work if work.phase == phase and task in (STAGE, work.task)]
    evaluating = sum(work.evaluation_motions for work in mine)
    acted = {
        "motions": sum(work.motions for work in mine),
        "evaluation_motions": None if phase == "fl" and not evaluating else evaluating,  # every round has an episode
    }
    return asdict(facts.parts[phase, task]) | acted


def _rewards_text(told: Mapping[int, float]) -> str:
    """R from round 0 on; none where a round did not tell it."""
    rounds = sorted(told)
    return " ".join(f"{told[round_]:.6g}" for round_ in rounds) if rounds == list(range(len(rounds))) else ""


def _rewards(rows: Sequence[RoundRow]) -> list[list[float]]:
    """[round][robot] rewards, in the order of rounds from 1."""
    told = sorted((row.round, row.agent, row.reward) for row in rows if row.round and row.reward is not None)
    return [[reward for *_, reward in of_round] for _, of_round in groupby(told, key=lambda row: row[0])]


def _slowest_s(rows: Sequence[RoundRow]) -> float:
    of_robot: dict[int, float] = {}
    for row in rows:
        of_robot[row.agent] = of_robot.get(row.agent, 0.0) + row.seconds
    return round(max(of_robot.values(), default=0.0), 3)


def _head(run: Run, arm: Arm) -> dict[str, str | int]:
    noted = computed_on(run.manifest).values()
    processor = "; ".join(sorted({each for processors in noted for each in processors}))
    head: dict[str, str | int] = {"variant": "", "seed": run.scenario.seed, "processor": processor}
    return head | {"arm": arm.name, "method": arm.method, "t0": arm.t0}
