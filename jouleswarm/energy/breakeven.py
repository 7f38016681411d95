"""From how many tasks on, or how many returns of one, learning a model in the data center first pays. Pure.

Of M tasks the data center has learned from Q, which are seen; M - Q are not, and save less.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import replace
from statistics import fmean
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, price


class Savings(NamedTuple):
    """Joules of the stage before, and what a task saves by it: its own learning without, less that with it."""

    stage_j: float
    """Learning the model: eq. (8) without what goes down to the robots of a task, which is the task's."""
    seen_j: float
    """Saved by a task that the data center has learned from; negative where it costs more."""
    unseen_j: float
    """Saved by any other."""
    seen_tasks: int
    """Q."""
    plain_j: float = 0.0
    """Of one task without."""


def savings(facts: Facts, plain: Facts, seen: Collection[int], energy: Energy, prices: PriceList) -> Savings | None:
    """By an arm with a stage before, over one without.

    What goes down to a task's robots is the task's. Where there are seen tasks alone, or none, others save as much.

    Args:
        facts: of the arm with a stage.
        plain: of the one without, that learned the same tasks.
        seen: tasks that the stage was learned from.
        energy: constants.
        prices: the list; without a bill for a part of it there is no answer.
    """
    tasks = list(facts.rounds)
    whole, stage = (_total(each, energy, prices) for each in (facts.of_ml(), stage_alone(facts.of_ml())))
    costs = [_total(facts.of_task(task), energy, prices) for task in tasks]
    plain_costs = [_total(plain.of_task(task), energy, prices) for task in tasks]
    if whole is None or stage is None or not tasks:
        return None
    robots, saved = sum(facts.robots[task] for task in tasks), {}
    for task, cost, other in zip(tasks, costs, plain_costs, strict=True):
        if cost is None or other is None:
            return None
        saved[task] = other - cost - (whole - stage) * facts.robots[task] / robots
    known = [saved[task] for task in tasks if task in seen]
    new = [saved[task] for task in tasks if task not in seen]
    return Savings(
        stage, _mean(known or new), _mean(new or known), len(known), _mean(each for each in plain_costs if each)
    )


def tasks_to_pay(savings: Savings) -> float:
    """M*: with more tasks than this it pays; infinite where no number of tasks is enough.

    stage_j = min(M, Q) seen_j + max(M - Q, 0) unseen_j. Among the seen tasks alone M* may be a fraction of Q.
    """
    stage_j, seen_j, unseen_j, seen, _ = savings
    if seen_j > 0 and seen * seen_j >= stage_j:
        return stage_j / seen_j
    if unseen_j <= 0:
        return math.inf
    return seen + (stage_j - seen * seen_j) / unseen_j


class Kind(NamedTuple):
    """Tasks that cost the same."""

    number: float
    """How many there are; infinite: as many as are asked for."""
    plain_j: float
    """Of one without a stage."""
    mine_j: float
    """Of one with it, without the stage itself."""


def tasks_for(factor: float, stage_j: float, kinds: Iterable[Kind]) -> float:
    """From how many tasks on the bill without is `factor` times that with the stage; infinite: never.

    The first kind's come first, then the next one's. With M tasks: sum plain_j = factor (stage_j + sum mine_j).
    """
    done, left_j = 0.0, factor * stage_j
    for number, plain_j, mine_j in kinds:
        each_j = plain_j - factor * mine_j
        if each_j > 0 and left_j <= number * each_j:
            return done + left_j / each_j
        if math.isinf(number):
            break
        done, left_j = done + number, left_j - number * each_j
    return math.inf


def returns_to_pay(savings: Savings) -> float:
    """How often seen tasks must come back, each learned anew, until their savings pay for the stage; may be infinite.

    The continual case: tasks return, and none is new.
    """
    return savings.stage_j / savings.seen_j if savings.seen_j > 0 else math.inf


def gain(savings: Savings, tasks: float) -> float:
    """Joules of `tasks` tasks without over those with the stage; above 1 it pays."""
    seen = min(tasks, savings.seen_tasks)
    without_j = tasks * savings.plain_j
    saved_j = seen * savings.seen_j + (tasks - seen) * savings.unseen_j
    return without_j / (savings.stage_j + without_j - saved_j)


def stage_alone(stage: Facts) -> Facts:
    """A phase ml without what goes down from it, which is the tasks'."""
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
