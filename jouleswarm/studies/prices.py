"""Facts priced: the bill of each arm of each run, for any efficiencies, by any price list."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.facts import STAGE, Counts, Facts, Phase
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, price, with_beta
from jouleswarm.energy.published import published
from jouleswarm.methods.shipped import shipped
from jouleswarm.studies.facts import META_STAGE, Fact

PRICE_LISTS: tuple[PriceList, ...] = (literal, published)


class Efficiencies(NamedTuple):
    """Uplink and sidelink efficiency; the downlink's is the uplink's unless the scenario sets it."""

    ul_bit_per_j: float
    sl_bit_per_j: float

    def of(self, energy: Energy) -> Energy:
        """The energy constants at these efficiencies."""
        return energy.model_copy(update=self._asdict())

    @property
    def label(self) -> str:
        """`200/500 kb/J`."""
        return f"{self.ul_bit_per_j / 1e3:g}/{self.sl_bit_per_j / 1e3:g} kb/J"


PAIRS = (Efficiencies(200e3, 500e3), Efficiencies(500e3, 200e3))
"""The two pairs of the paper's Fig. 4a."""


def with_motions(facts: Iterable[Fact], scenario: Scenario) -> list[Fact]:
    """Facts with the motions of those that are from before motions were noted.

    A robot of a cluster moves `motions_per_round` times a round, and so does a training robot, of whom there were as
    many as there were batches a round over those of one.
    """
    learning, meta = scenario.learning, scenario.meta

    def derived(fact: Fact) -> float:
        if fact.task == META_STAGE:
            batches = fact.gradients_support + fact.gradients_query
            return batches / (meta.support_batches + meta.query_batches) * learning.motions_per_round
        alone = scenario.method(fact.method).partners == "nobody"  # each stops by itself, so its gradients tell
        rounds = fact.gradients_robots / learning.batches_per_round if alone else fact.rounds * fact.robots
        return rounds * learning.motions_per_round

    return [each if each.motions is not None else each.model_copy(update={"motions": derived(each)}) for each in facts]


def facts_of(facts: Sequence[Fact]) -> Facts:
    """One arm of one run as price lists are given it: sums by phase and task, no single flows or processes."""
    stage, tasks = next((fact for fact in facts if fact.task == META_STAGE), None), task_stages(facts)
    first: dict[tuple[Phase, int], Counts] = {("ml", STAGE): stage.counts} if stage else {}
    return Facts(
        arm=facts[0].arm,
        method=facts[0].method,
        t0=stage.t0 if stage else 0,
        parts=first | {("fl", fact.task): fact.counts for fact in tasks},
        rounds={fact.task: fact.rounds for fact in tasks},
        robots={fact.task: fact.robots for fact in tasks},
        links={fact.task: fact.links for fact in tasks},
        beta=stage.beta if stage and stage.gradients_query else 1.0,
        exact=_exact(facts[0].method, stage),
    )


def _exact(method: str, stage: Fact | None) -> bool:
    """Whether gradients on B^(b) go back through an adaptation: of a user's method by the beta that is kept of it."""
    if (kind := shipped(method)) is not None:
        return kind.exact
    return stage is not None and stage.beta != 1


def priced(facts: Sequence[Fact], energy: Energy, prices: PriceList) -> Bill | None:
    """The bill of one arm of one run; None where the list is not defined, or asks for more than a study's facts hold.

    Args:
        facts: of one arm and seed, one a stage; without a meta stage it costs nothing.
        energy: constants and efficiencies.
        prices: which price list.
    """
    return price(prices, facts_of(facts), energy)


def cost_of(facts: Sequence[Fact], energy: Energy) -> Cost:
    """What one arm of one run cost by cause, literal prices.

    Raises:
        UnknownFactError: the constants are such that sums do not do.
    """
    held = facts_of(facts)
    return literal.price(held, with_beta(energy, held)).both


def of_tasks(run: Sequence[Fact], tasks: Collection[int]) -> list[Fact]:
    """Of one arm of one run some tasks' facts, with the whole stage but of its way down only what is theirs."""
    held = task_stages(run)
    mine = [fact for fact in held if fact.task in tasks]
    share = sum(fact.robots for fact in mine) / max(1, sum(fact.robots for fact in held))
    stage = [fact for fact in run if fact.task == META_STAGE]
    theirs = [fact.model_copy(update={"downlink_bytes": share * fact.downlink_bytes}) for fact in stage]
    return [*theirs, *mine]


def moved_bytes(facts: Iterable[Fact]) -> float:
    """Bytes delivered over all priced links."""
    return math.fsum(fact.uplink_bytes + fact.downlink_bytes + fact.sidelink_bytes for fact in facts)


def moved_motions(facts: Iterable[Fact]) -> float:
    """Motions of all robots and stages, to learn from."""
    return math.fsum(fact.motions or 0 for fact in facts)


def runs_of(facts: Iterable[Fact], variant: str, arm: str) -> dict[int, list[Fact]]:
    """Facts of one variant's arm, seed by seed."""
    found: dict[int, list[Fact]] = {}
    for fact in facts:
        if (fact.variant, fact.arm) == (variant, arm):
            found.setdefault(fact.seed, []).append(fact)
    return dict(sorted(found.items()))


def task_stages(facts: Iterable[Fact]) -> list[Fact]:
    """The facts of tasks' own stages."""
    return [fact for fact in facts if fact.task != META_STAGE]


def failures(facts: Iterable[Fact]) -> int:
    """How many task stages ended without the task learned."""
    return sum(not fact.learned for fact in task_stages(facts))
