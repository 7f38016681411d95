"""How many tasks it takes until meta-learning pays, by pricing measured counts again. Nothing is trained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.energy.equations import Counts, price
from jouleswarm.runs.paper import published_of
from jouleswarm.studies.facts import META_STAGE, Fact
from jouleswarm.studies.prices import PriceList


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
    )


def costs(found: MeanCounts, energy: Energy, prices: PriceList = "literal") -> Costs | None:
    """Price mean counts; None where the price list is not defined."""
    if prices == "literal":
        joules = (price(counts, energy).total_j for counts in (found.meta, found.task, found.plain))
        return Costs(*joules)
    published = [
        published_of(found.method, t0, rounds, energy)
        for t0, rounds in ((found.t0, 0.0), (0.0, found.task_rounds), (0.0, found.plain_rounds))
    ]
    held = [each.total_j for each in published if each is not None]
    return Costs(*held) if len(held) == len(published) else None


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
    candidates: Sequence[MeanCounts], energy: Energy, tasks: NDArray[np.float64], ul_over_sl: NDArray[np.float64]
) -> NDArray[np.float64]:
    """`gain` of the best candidate at each point, by the literal prices.

    Args:
        candidates: mean counts, one a t0.
        energy: constants; its sidelink efficiency stays, the uplink's follows.
        tasks: [columns] numbers of tasks M.
        ul_over_sl: [rows] E_UL / E_SL.

    Returns:
        [rows, columns] joules without over joules with meta-learning.
    """
    rows = []
    for ratio in ul_over_sl:
        here = energy.model_copy(update={"ul_bit_per_j": float(ratio) * energy.sl_bit_per_j})
        found = [costs(each, here) for each in candidates]
        rows.append(np.max([gain(each, tasks) for each in found if each is not None], axis=0))
    return np.array(rows)


def _mean(counts: Sequence[Counts]) -> Counts:
    total = sum(counts, Counts())
    return Counts(**{name: value / len(counts) for name, value in vars(total).items()})
