"""How many tasks it takes until meta-learning pays, by pricing measured counts again. Nothing is trained."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import STAGE, Counts, Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.studies.facts import META_STAGE, Fact


class Costs(NamedTuple):
    """Joules that M tasks cost: `meta_j` + M x `task_j` with meta-learning, M x `plain_j` without."""

    meta_j: float
    task_j: float
    plain_j: float


@dataclass(frozen=True)
class MeanCounts:
    """Mean counts over seeds: of the meta-learning stage and of one task, with it and without."""

    method: str
    t0: int
    meta: Counts
    task: Counts
    plain: Counts
    task_rounds: float
    plain_rounds: float
    robots: int = 2
    """Of each cluster; 0 where they differ, as `links`."""
    links: int = 2

    def facts(self) -> tuple[Facts, Facts, Facts]:
        """The stage, one task with it and one without, as price lists are given them."""
        clusters: dict[str, Any] = {"method": self.method, "robots": {1: self.robots}, "links": {1: self.links}}
        return (
            Facts("", t0=self.t0, parts={("ml", STAGE): self.meta}, **clusters),
            Facts("", t0=0, parts={("fl", 1): self.task}, rounds={1: self.task_rounds}, **clusters),
            Facts("", t0=0, parts={("fl", 1): self.plain}, rounds={1: self.plain_rounds}, **clusters),
        )


def mean_counts(with_meta: Sequence[Fact], without: Sequence[Fact]) -> MeanCounts:
    """Reduce the facts of two arms, all seeds together.

    What goes down to the robots grows with the tasks that adapt, so it counts as the tasks' and not as the
    meta-stage's; what goes up and is learned from does not.

    Raises:
        StudyError: an arm has no facts, or the first no meta-learning stage.
    """
    meta = [fact for fact in with_meta if fact.task == META_STAGE]
    tasks = [fact for fact in with_meta if fact.task != META_STAGE]
    if not meta or not tasks or not without:
        got = f"{len(meta)} meta-learning stages, {len(tasks)} tasks with and {len(without)} without"
        raise StudyError(f"break-even: got facts of {got}, expected some of each; run both arms")
    stage = _mean([fact.counts for fact in meta])
    down = Counts(downlink_bytes=stage.downlink_bytes * len(meta) / len(tasks))
    return MeanCounts(
        method=meta[0].method,
        t0=meta[0].t0,
        meta=stage + Counts(downlink_bytes=-stage.downlink_bytes),
        task=_mean([fact.counts for fact in tasks]) + down,
        plain=_mean([fact.counts for fact in without]),
        task_rounds=fmean(fact.rounds for fact in tasks),
        plain_rounds=fmean(fact.rounds for fact in without),
        robots=_same(fact.robots for fact in (*tasks, *without)),
        links=_same(fact.links for fact in (*tasks, *without)),
    )


def costs(found: MeanCounts, energy: Energy, prices: PriceList = literal) -> Costs | None:
    """Price mean counts; None where the price list is not defined."""
    bills = [price(prices, facts, energy) for facts in found.facts()]
    held = [bill.total_j for bill in bills if bill is not None]
    return Costs(*held) if len(held) == len(bills) else None


def break_even_tasks(found: Costs) -> float:
    """M*: with more tasks than this meta-learning pays; infinite where no number of tasks is enough.

    meta_j + M task_j = M plain_j, so M* = meta_j / (plain_j - task_j).
    """
    saved_j = found.plain_j - found.task_j
    return found.meta_j / saved_j if saved_j > 0 else math.inf


def gain(found: Costs, tasks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Joules without over joules with meta-learning, for each number of tasks; above 1 it pays."""
    ratio: NDArray[np.float64] = tasks * found.plain_j / (found.meta_j + tasks * found.task_j)
    return ratio


def gain_map(
    candidates: Sequence[MeanCounts],
    energy: Energy,
    tasks: NDArray[np.float64],
    ul_over_sl: NDArray[np.float64],
    prices: PriceList = literal,
) -> NDArray[np.float64]:
    """`gain` of the best candidate at each point.

    Args:
        candidates: mean counts, one a t0.
        energy: constants; its sidelink efficiency stays, the uplink's follows.
        tasks: [columns] numbers of tasks M.
        ul_over_sl: [rows] E_UL / E_SL.
        prices: which price list; NaN where it has no bill for any candidate.

    Returns:
        [rows, columns] joules without over joules with meta-learning.
    """
    rows = []
    for ratio in ul_over_sl:
        here = energy.model_copy(update={"ul_bit_per_j": float(ratio) * energy.sl_bit_per_j})
        found = [costs(each, here, prices) for each in candidates]
        gains = [gain(each, tasks) for each in found if each is not None]
        rows.append(np.max(gains, axis=0) if gains else np.full(len(tasks), np.nan))
    return np.array(rows)


def _same(values: Iterable[int]) -> int:
    """The value that all have; 0 where they differ."""
    found = set(values)
    return found.pop() if len(found) == 1 else 0


def _mean(counts: Sequence[Counts]) -> Counts:
    total = sum(counts, Counts())
    return Counts(**{name: value / len(counts) for name, value in vars(total).items()})
