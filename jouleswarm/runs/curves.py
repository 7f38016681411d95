"""A run's curves: after each round of each arm what had been spent, in all that can be spent, and what was learned."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from statistics import fmean
from typing import Any

import pandas as pd

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.curves import curve
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.items import BITS_PER_BYTE
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, price, with_beta
from jouleswarm.energy.times import times
from jouleswarm.runs.run import Run

SPENT = {
    "joules": "energy (J)",
    "bits": "moved on all links (bit)",
    "seconds": "time (s)",
    "gradients": "batch gradients",
    "motions": "motions",
}
"""Columns of what is spent, and what they are."""


def curves(run: Run, energy: Energy, prices: PriceList = literal) -> pd.DataFrame:
    """A row an arm and round, from 0, the stage alone, until the arm's last cluster is done.

    Columns: arm, round, those of `SPENT`, learned (tasks, as text), share_learned, reward: the mean over tasks of the
    cluster's R. Joules are NaN where the list has no bill or bytes were not counted, seconds where a rate is not known.
    """
    rows = [row for arm in run.scenario.arm_names for row in _rows(run, arm, energy, prices)]
    return pd.DataFrame(rows, columns=["arm", "round", *SPENT, "learned", "share_learned", "reward"])


def within(points: pd.DataFrame, budget: float, what: str = "joules") -> dict[str, pd.Series[Any] | None]:
    """By arm the last row that a budget reaches; None where it does not even pay for the stage."""
    found: dict[str, pd.Series[Any] | None] = {}
    for arm, rows in points.groupby("arm", sort=False):
        reached = rows[rows[what] <= budget]
        found[str(arm)] = reached.iloc[-1] if len(reached) else None
    return found


def _rows(run: Run, arm: str, energy: Energy, prices: PriceList) -> Iterator[list[Any]]:
    facts = run.facts[arm]
    learned = {result.task: result.learned for result in run.results[arm]}
    rewards = rewards_by_round(run, arm)
    for round_, here, done in curve(facts, learned):
        told = [
            reward for task in rewards if (reward := rewards[task].get(min(round_, max(rewards[task])))) is not None
        ]
        spent = (spend(here) for spend in _spending(energy, prices))
        share = len(done) / len(learned) if learned else 0.0
        yield [arm, round_, *spent, " ".join(map(str, done)), share, fmean(told) if told else None]


def _spending(energy: Energy, prices: PriceList) -> tuple[Callable[[Facts], float | None], ...]:
    """In the order of `SPENT`."""

    def joules(facts: Facts) -> float | None:
        bill = price(prices, facts, energy) if facts.metered else None
        return None if bill is None else bill.total_j

    def bits(facts: Facts) -> float | None:
        counts = facts.counts.ml + facts.counts.fl
        moved = counts.uplink_bytes + counts.downlink_bytes + counts.sidelink_bytes
        return BITS_PER_BYTE * moved if facts.metered else None

    def seconds(facts: Facts) -> float | None:
        return times(facts, with_beta(energy, facts)).total.total_s

    def gradients(facts: Facts) -> float:
        counts = facts.counts.ml + facts.counts.fl
        return counts.gradients_support + counts.gradients_query + counts.gradients_robots

    def motions(facts: Facts) -> float:
        return sum(work.motions + work.evaluation_motions for work in facts.work)

    return joules, bits, seconds, gradients, motions


def rewards_by_round(run: Run, arm: str) -> dict[int, dict[int, float]]:
    """Task -> round -> the cluster's R, the mean of its robots' where each has its own."""
    held: dict[int, dict[int, list[float]]] = {}
    for row in run.rows:
        if (row.phase, row.arm) == (RowPhase.FL, arm) and row.agent and row.cluster_reward is not None:
            held.setdefault(row.task, {}).setdefault(row.round, []).append(row.cluster_reward)
    return {task: {round_: fmean(every) for round_, every in of.items()} for task, of in held.items()}
