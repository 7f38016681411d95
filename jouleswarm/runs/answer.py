"""What a run says, as numbers: what each arm learned and cost, and what holding one against another comes to. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import Joules, cause_parts
from jouleswarm.energy.breakeven import savings, tasks_to_pay
from jouleswarm.energy.carbon import at_sites, carbon, has_carbon
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, is_whole, price, with_beta
from jouleswarm.energy.why import total_of, turning
from jouleswarm.methods.consensus import BASELINE
from jouleswarm.runs.facts import TaskResult, path_error, zero_shot_share

TURNING = ("ul_bit_per_j", "sl_bit_per_j")
"""Constants whose other values are looked for at which two arms cost the same."""


@dataclass(frozen=True)
class Spent:
    """One arm."""

    arm: str
    t0: int
    """Rounds of the stage before."""
    rounds: float
    """Sum of t_i."""
    tasks: int
    learned: int
    """How many of them were."""
    zero_shot: int
    """How many of them before their first round."""
    total_j: Joules
    by_cause_j: Mapping[str, Joules]
    """By the keys of `energy.bill.CAUSES`; all None where the list does not tell."""
    carbon_g: float | None = None
    """Grams of CO2 equivalent; None where an intensity is not known."""
    rmse_m: float | None = None
    """Path error at the end, the mean of all tasks; None where there is no path."""
    worst_rmse_m: float | None = None
    """That of the worst task."""

    @property
    def has_learned(self) -> bool:
        """All tasks."""
        return 0 < self.tasks == self.learned

    @property
    def largest(self) -> tuple[str, float] | None:
        """What most was spent on, and its share of the total; None where that is not known."""
        known = {cause: joules for cause, joules in self.by_cause_j.items() if joules}
        if not known or not self.total_j:
            return None
        cause = max(known, key=known.__getitem__)
        return cause, known[cause] / self.total_j


@dataclass(frozen=True)
class Against:
    """One arm held against another that learned the same."""

    arm: str
    other: str
    factor: float
    """Joules of the one over those of the other: above 1 it costs more."""
    turns_at: Mapping[str, float]
    """The nearest value, in bit/J, at which both cost the same; of `TURNING`, those that have one."""
    has_stage: bool
    """Whether it learns a model first that more tasks could share."""
    pays_from_tasks: float | None
    """With more tasks than this the stage is paid for; None: more tasks than there are do not help, or it is not
    known."""


@dataclass(frozen=True)
class Answer:
    """What a reader wants to know of a run first."""

    status: str
    trusted: bool
    """Whether the counters of broker and clients fit."""
    prices: str
    """Name of the price list that it is told by: the equations over what was counted, where the run has them."""
    plain: str
    """The arm that the others are held against."""
    arms: Mapping[str, Spent]
    against: tuple[Against, ...]
    """Of arms that may be compared with it: a bill at unequal reward, of a run that did not end, or of counters that do
    not fit, is no verdict."""

    @property
    def cheapest(self) -> Spent | None:
        """Of the arms that may be compared."""
        names = [self.plain, *(each.arm for each in self.against)] if self.against else []
        return min((self.arms[name] for name in names), key=lambda each: each.total_j or math.inf, default=None)

    @property
    def document(self) -> dict[str, Any]:
        """As plain data, for summary.json."""
        arms = {
            name: {key: value for key, value in asdict(each).items() if key not in ("arm", "by_cause_j")}
            for name, each in self.arms.items()
        }
        for name, each in self.arms.items():
            cause, share = each.largest or (None, None)
            arms[name] |= {"largest_cause": cause, "largest_share": share}
        against = [asdict(each) for each in self.against]
        return {"prices": self.prices, "held_against": self.plain, "arms": arms, "against": against}


def answer_of(
    scenario: Scenario,
    facts: Mapping[str, Facts],
    results: Mapping[str, Sequence[TaskResult]],
    energy: Energy,
    lists: Sequence[PriceList],
    *,
    status: str = "complete",
    trusted: bool = True,
) -> Answer:
    """The answer of a run, from what its arms have done.

    Args:
        scenario: what was run.
        facts, results: by arm.
        energy: constants.
        lists: the run's price lists.
        status: complete, interrupted or failed.
        trusted: whether the counters of broker and clients fit.

    Raises:
        ConfigurationError: a price list of the user's fails.
    """
    prices = next((each for each in (literal, *lists) if each in lists), literal)
    arms = {arm: _spent(facts[arm], results[arm], energy, prices) for arm in scenario.arm_names}
    plain = _plain(arms)
    against: tuple[Against, ...] = ()
    if status == "complete" and trusted and arms[plain].has_learned and arms[plain].total_j:
        against = tuple(_held(scenario, facts, arms, plain, energy, prices))
    return Answer(status, trusted, prices.name, plain, arms, against)


def _plain(arms: Mapping[str, Spent]) -> str:
    """The arm without transfer, if it learned all tasks; else the first that did, before others one without a stage."""
    order = sorted(arms.values(), key=lambda each: (not each.has_learned, each.arm != BASELINE, each.t0 > 0))
    return order[0].arm


def _spent(facts: Facts, results: Sequence[TaskResult], energy: Energy, prices: PriceList) -> Spent:
    bill = price(prices, facts, energy)
    known = bill is not None and is_whole(prices, facts)
    causes = cause_parts(bill.both if bill else None, facts.metered)
    rmse_m, worst_rmse_m = path_error(results) or (None, None)
    return Spent(
        arm=facts.arm,
        t0=round(facts.t0),
        rounds=sum(facts.rounds.values()),
        tasks=len(results),
        learned=sum(result.learned for result in results),
        zero_shot=round(zero_shot_share(results) * len(results)) if results else 0,
        total_j=bill.total_j if bill and known else None,
        by_cause_j={cause.key: joules for cause, joules in causes.items()},
        carbon_g=carbon(bill, at_sites(energy, facts)).total_g if bill and known and has_carbon(energy) else None,
        rmse_m=rmse_m,
        worst_rmse_m=worst_rmse_m,
    )


def _held(
    scenario: Scenario,
    facts: Mapping[str, Facts],
    arms: Mapping[str, Spent],
    plain: str,
    energy: Energy,
    prices: PriceList,
) -> Iterator[Against]:
    other, plain_j = facts[plain], arms[plain].total_j
    for name, spent in arms.items():
        if name == plain or not spent.has_learned or not spent.total_j or not plain_j:
            continue
        mine, here = facts[name], with_beta(energy, facts[name])
        bills = total_of(mine, prices), total_of(other, prices, with_beta(energy, other).beta)
        factors = {constant: turning(here, constant, *bills) for constant in TURNING}
        turns_at = {each: factor * getattr(here, each) for each, factor in factors.items() if factor is not None}
        has_stage = bool(spent.t0) and not arms[plain].t0
        saved = savings(mine, other, scenario.meta.training_tasks, here, prices) if has_stage else None
        tasks = tasks_to_pay(saved) if saved else math.inf
        factor = spent.total_j / plain_j
        lost_again = factor > 1 and tasks < spent.tasks  # a seen task saves, and the others cost more than it saved
        even = None if lost_again or math.isinf(tasks) else tasks
        yield Against(name, plain, factor, turns_at, has_stage, even)
