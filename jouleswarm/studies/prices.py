"""Facts priced: joules of each stage, for any efficiencies, by either price list."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from jouleswarm.common.scenario.sections import Energy
from jouleswarm.energy.bill import Cost
from jouleswarm.energy.equations import Counts, price
from jouleswarm.runs.paper import CLUSTER_ROBOTS, published_of
from jouleswarm.studies.facts import META_STAGE, Fact

PriceList = Literal["literal", "published"]
PRICE_LISTS: tuple[PriceList, ...] = ("literal", "published")


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


class StageJoules(NamedTuple):
    """Joules of one stage by cause; the published price list does not tell causes apart."""

    learning_j: float | None
    communication_j: float | None
    total_j: float


@dataclass(frozen=True)
class RunJoules:
    """One arm of one run, priced."""

    meta: StageJoules
    tasks: dict[int, StageJoules]

    @property
    def tasks_j(self) -> float:
        """Sum of E_FL over the tasks, eq. (10)."""
        return math.fsum(stage.total_j for stage in self.tasks.values())

    @property
    def total_j(self) -> float:
        """E, eq. (12)."""
        return self.meta.total_j + self.tasks_j


def priced(facts: Sequence[Fact], energy: Energy, prices: PriceList) -> RunJoules | None:
    """Joules of one arm of one run; None where the price list is not defined (see `energy.equations`).

    Args:
        facts: of one arm and seed, one a stage; without a meta stage it costs nothing.
        energy: constants and efficiencies.
        prices: which price list.
    """
    stages = {fact.task: _stage(fact, energy, prices) for fact in facts}
    held = {task: stage for task, stage in stages.items() if stage is not None}
    if len(held) < len(stages):
        return None
    meta = held.pop(META_STAGE, StageJoules(0.0, 0.0, 0.0))
    return RunJoules(meta, held)


class Causes(NamedTuple):
    """Joules of one run by what they were spent on; they add up to E, eq. (12)."""

    center_j: float
    """Computing in the data center, PUE included."""
    robots_j: float
    """Computing on the robots."""
    uplink_j: float
    downlink_j: float
    sidelink_j: float

    @property
    def total_j(self) -> float:
        """E, eq. (12)."""
        return math.fsum(self)


def causes(facts: Iterable[Fact], energy: Energy) -> Causes:
    """Joules of one arm of one run by cause, literal prices."""
    cost = cost_of(facts, energy)
    return Causes(cost.center_computing_j, cost.robot_computing_j, cost.uplink_j, cost.downlink_j, cost.sidelink_j)


def cost_of(facts: Iterable[Fact], energy: Energy) -> Cost:
    """What one arm of one run cost, literal prices."""
    return price(sum((fact.counts for fact in facts), Counts()), energy)


def moved_bytes(facts: Iterable[Fact]) -> float:
    """Bytes delivered over all priced links."""
    return math.fsum(fact.uplink_bytes + fact.downlink_bytes + fact.sidelink_bytes for fact in facts)


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


def _stage(fact: Fact, energy: Energy, prices: PriceList) -> StageJoules | None:
    if prices == "literal":
        cost = price(fact.counts, energy)
        return StageJoules(cost.learning_j, cost.communication_j, cost.total_j)
    meta = fact.task == META_STAGE
    if not meta and fact.robots != CLUSTER_ROBOTS:
        return None
    published = published_of(fact.method, fact.t0 if meta else 0, 0 if meta else fact.rounds, energy)
    return None if published is None else StageJoules(None, None, published.total_j)
