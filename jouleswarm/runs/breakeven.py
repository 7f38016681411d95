"""What learning a model first saved in a run, by tasks that the data center has learned from and others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from statistics import fmean

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.breakeven import Savings
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.methods.consensus import BASELINE
from jouleswarm.runs.run import Run


def comparable(run: Run) -> list[Arm]:
    """Arms with a stage before that learned all tasks, of a complete run that can be trusted and in which the arm
    without transfer learned all too: a bill at unequal reward is no verdict."""
    held = {arm: all(result.learned for result in results) for arm, results in run.results.items()}
    if run.status != "complete" or run.misfits or not held.get(BASELINE):
        return []
    return [arm for arm in run.scenario.arms if arm.t0 and held[arm.name]]


def savings(run: Run, arm: str, plain: str, energy: Energy, prices: PriceList) -> Savings | None:
    """By one arm with a stage before, over one without.

    What goes down to a task's robots is the task's. Where there are seen tasks alone, or none, others save as much.
    None where the list has no bill for a part of it.
    """
    facts, without = run.facts[arm], run.facts[plain]
    whole, stage = (_total(each, energy, prices) for each in (facts.of_ml(), _without_downlink(facts.of_ml())))
    costs = {task: _total(facts.of_task(task), energy, prices) for task in facts.rounds}
    plain_costs = {task: _total(without.of_task(task), energy, prices) for task in without.rounds}
    if whole is None or stage is None or not costs:
        return None
    robots = sum(facts.robots[task] for task in costs)
    saved = {}
    for task, cost in costs.items():
        other = plain_costs.get(task)
        if cost is None or other is None:
            return None
        saved[task] = other - cost - (whole - stage) * facts.robots[task] / robots
    seen = [task for task in saved if task in run.scenario.meta.training_tasks]
    unseen = [task for task in saved if task not in seen]
    seen_j, unseen_j = _mean(saved[task] for task in seen), _mean(saved[task] for task in unseen)
    return Savings(stage, seen_j if seen else unseen_j, unseen_j if unseen else seen_j, len(seen))


def _without_downlink(stage: Facts) -> Facts:
    parts = {key: replace(counts, downlink_bytes=0) for key, counts in stage.parts.items()}
    flows = stage.known_flows
    kept = None if flows is None else tuple(flow for flow in flows if flow.link != Link.DOWNLINK)
    return replace(stage, parts=parts, known_flows=kept)


def _total(facts: Facts, energy: Energy, prices: PriceList) -> float | None:
    bill = price(prices, facts, energy)
    return None if bill is None else bill.total_j


def _mean(values: Iterable[float]) -> float:
    held = list(values)
    return fmean(held) if held else 0.0
