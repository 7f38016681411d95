"""How many tasks it takes until meta-learning pays, by pricing counted facts again. Nothing is trained."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from statistics import fmean
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.breakeven import Savings, gain, savings
from jouleswarm.energy.closed_form import TABLE_I
from jouleswarm.energy.facts import Counts, Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList
from jouleswarm.studies.facts import META_STAGE, Fact
from jouleswarm.studies.prices import facts_of, runs_of

_DRAWS = 2000


class Compared(NamedTuple):
    """Facts of one arm with a stage, and of the arm without, by the same seeds."""

    arm: str
    t0: int
    mine: list[Facts]
    plain: list[Facts]
    seen: Collection[int]
    """Tasks that the stage was learned from."""
    variant: str = ""

    @property
    def method(self) -> str:
        """Of the first."""
        return self.mine[0].method

    def means(self, energy: Energy, prices: PriceList = literal) -> Savings | None:
        """Of the mean over seeds; None where the price list is not defined."""
        return savings(mean_facts(self.mine), mean_facts(self.plain), self.seen, energy, prices)

    def between(
        self, of: Callable[[Savings], float], energy: Energy, prices: PriceList = literal
    ) -> tuple[float, float] | None:
        """The middle 95% over seeds drawn again with replacement (Efron 1979); may be infinite. None of one seed."""
        found = [
            savings(mine, plain, self.seen, energy, prices) for mine, plain in zip(self.mine, self.plain, strict=True)
        ]
        held = [each for each in found if each is not None]
        if len(held) < 2 or len(held) < len(found):
            return None
        table = np.array(held)  # [seeds, fields of Savings]
        drawn = np.random.default_rng(1).integers(len(held), size=(_DRAWS, len(held)))
        each = [of(Savings(*row)) for row in table[drawn].mean(axis=1)]
        low, high = np.quantile(each, [0.025, 0.975], method="inverted_cdf")  # between two infinities is nothing
        return float(low), float(high)


def compared(facts: Sequence[Fact], arm: str, plain: str, seen: Collection[int]) -> Compared:
    """Two arms of a study over the seeds that both have.

    Raises:
        StudyError: an arm has no facts, or the first no meta-learning stage.
    """
    ours, theirs = (runs_of(facts, "", each) for each in (arm, plain))
    seeds = [seed for seed in ours if seed in theirs]
    mine = [facts_of(ours[seed]) for seed in seeds]
    if not seeds or not all(each.t0 for each in mine):
        got = f"{len(ours)} runs of {arm or 'no arm'} with a stage and {len(theirs)} of {plain}"
        raise StudyError(f"break-even: got {got}, expected some of each with the same seeds; run both arms")
    return Compared(arm, int(mine[0].t0), mine, [facts_of(theirs[seed]) for seed in seeds], seen)


def at_papers_sizes(facts: Sequence[Fact], training_robots: int) -> list[Fact]:
    """The same rounds and gradients with Table I's bytes, for whose network its T_0 and T_k are."""
    return [fact.model_copy(update=_papers_bytes(fact, training_robots)) for fact in facts]


def _papers_bytes(fact: Fact, training_robots: int) -> dict[str, float]:
    if fact.task == META_STAGE:
        up = fact.t0 * training_robots * TABLE_I.experience_bytes
        return {"uplink_bytes": up, "downlink_bytes": fact.robots * TABLE_I.weights_bytes}
    sent = fact.robots * fact.rounds if fact.links else 0
    moved = {"sidelink_bytes": fact.links * fact.rounds, "sidelink_sent_bytes": sent}
    return {name: messages * TABLE_I.weights_bytes for name, messages in moved.items()}


def mean_facts(runs: Sequence[Facts]) -> Facts:
    """The mean over runs of what was counted and of the rounds."""
    first = runs[0]
    parts = {
        key: Counts(*map(fmean, zip(*(vars(run.parts[key]).values() for run in runs), strict=True)))
        for key in first.parts
    }
    return replace(first, parts=parts, rounds={task: fmean(run.rounds[task] for run in runs) for task in first.rounds})


def gain_map(
    candidates: Sequence[Compared],
    energy: Energy,
    tasks: NDArray[np.float64],
    ul_over_sl: NDArray[np.float64],
    prices: PriceList = literal,
) -> NDArray[np.float64]:
    """`gain` of the best candidate at each point.

    Args:
        candidates: one a t0.
        energy: constants; its sidelink efficiency stays, the uplink's follows.
        tasks: [columns] numbers of tasks M.
        ul_over_sl: [rows] E_UL / E_SL.
        prices: which price list; NaN where it has no bill for any candidate.

    Returns:
        [rows, columns] joules without over joules with meta-learning.
    """
    means = [(mean_facts(each.mine), mean_facts(each.plain), each.seen) for each in candidates]
    rows = []
    for ratio in ul_over_sl:
        here = energy.model_copy(update={"ul_bit_per_j": float(ratio) * energy.sl_bit_per_j})
        found = [savings(mine, plain, seen, here, prices) for mine, plain, seen in means]
        gains = [[gain(each, number) for number in tasks] for each in found if each is not None]
        rows.append(np.max(gains, axis=0) if gains else np.full(len(tasks), np.nan))
    return np.array(rows)
