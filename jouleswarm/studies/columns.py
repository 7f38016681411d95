"""What tables and figures tell of an arm, each told once: its names, its unit, and its value of one run."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import CAUSES, PAPER_CAUSES, SITES, Cause, site_parts
from jouleswarm.energy.carbon import at_sites, carbon, has_carbon
from jouleswarm.energy.items import BITS_PER_BYTE
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, own_lists
from jouleswarm.studies.arms import copied_share, zero_shot_share
from jouleswarm.studies.estimates import Estimate, estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import cost_of, failures, moved_bytes, moved_motions, priced, runs_of, task_stages

Value = Callable[[list[Fact]], float | None]
"""Of the facts of one arm and seed; None where it is not known."""
Seen = Callable[[str], Collection[int]]
"""Variant -> tasks that its meta-training has seen."""


class Column(NamedTuple):
    """A value of each run, of which tables and figures have the mean over seeds and its interval."""

    name: str
    """In CSV."""
    heading: str
    """For readers, with the unit."""
    unit: float
    """What readers see one of, for example 1000 J."""
    of: Value
    counts: bool = True
    """Whether a run that was cut off makes it a lower bound."""

    @property
    def names(self) -> tuple[str, str]:
        """Of its two columns in CSV."""
        return self.name, f"{self.name}_ci95"

    def over(self, facts: Sequence[Fact], variant: str, arm: str) -> Estimate | None:
        """Over the seeds of one variant's arm; None where it is not known of every run."""
        values = [self.of(run) for run in runs_of(facts, variant, arm).values()]
        held = [value for value in values if value is not None]
        return estimate(held) if len(held) == len(values) else None

    def shown(self, facts: Sequence[Fact], variant: str, arm: str) -> Estimate:
        """The same in readers' units; nan where it is not known."""
        found = self.over(facts, variant, arm) or Estimate(math.nan, None, 0)
        return found.scaled(1 / self.unit)


def rounds_sum(run: list[Fact]) -> float:
    """Rounds of a run, summed over its tasks."""
    return sum(fact.rounds for fact in task_stages(run))


def total_column(prices: PriceList, energy: Energy, heading: str) -> Column:
    """E by a list; not known where it is not defined."""

    def total_j(run: list[Fact]) -> float | None:
        bill = priced(run, energy, prices)
        return bill.total_j if bill else None

    return Column("total_j" if prices is literal else f"{prices.name}_j", heading, 1e3, total_j)


def apart_columns(seen: Seen) -> list[Column]:
    """Rounds of unseen tasks and of seen ones, and what share of them was copied; not known where there are none."""

    def of(name: str, value: Value) -> Value:
        def held(run: list[Fact]) -> float | None:
            known = seen(run[0].variant)
            mine = [fact for fact in task_stages(run) if (fact.task in known) == (name == "seen")]
            return value(mine) if mine else None

        return held

    groups = ("unseen", "seen")
    rounds = [Column(f"rounds_{name}", f"rounds, {name}", 1, of(name, rounds_sum)) for name in groups]
    copied = [
        Column(f"copied_{name}", f"copied, {name} (%)", 0.01, of(name, copied_share), counts=False) for name in groups
    ]
    return [*rounds, *copied]


MOTIONS = Column("motions", "motions", 1, moved_motions)


def cause_columns(energy: Energy, causes: Sequence[Cause] = PAPER_CAUSES) -> list[Column]:
    """Joules by cause, literal prices: these have no other. Of evaluation not known where its motions are not."""

    def spent_on(cause: Cause) -> Value:
        def value(run: list[Fact]) -> float | None:
            uncounted = cause.key == "evaluating" and any(fact.evaluation_motions is None for fact in task_stages(run))
            return None if uncounted else cost_of(run, energy).by_cause[cause]

        return value

    return [Column(cause.column, f"{cause.heading} (kJ)", 1e3, spent_on(cause)) for cause in causes]


def phase_columns(energy: Energy) -> list[Column]:
    """E_ML and E_FL, literal prices."""
    names = {"ml": "E_ML (kJ)", "fl": "E_FL (kJ)"}
    return [Column(f"{phase}_j", heading, 1e3, partial(_phase_j, energy, phase)) for phase, heading in names.items()]


def site_columns(energy: Energy, prices: PriceList = literal) -> list[Column]:
    """Who pays; not known where a price list does not tell."""

    def paid(site: str) -> Value:
        def value(run: list[Fact]) -> float | None:
            bill = priced(run, energy, prices)
            return site_parts(bill.both if bill else None)[site]

        return value

    return [Column(f"paid_by_{site}_j", f"paid by {name} (kJ)", 1e3, paid(site)) for site, name in SITES.items()]


def carbon_columns(energy: Energy, prices: PriceList = literal) -> list[Column]:
    """Grams of CO2 equivalent by site and together; none where no site's intensity is set.

    A site whose intensity is not known has none, and no site where a price list does not tell sites apart.
    """

    def grams(name: str) -> Value:
        def value(run: list[Fact]) -> float | None:
            bill = priced(run, energy, prices)
            found: float | None = getattr(carbon(bill, at_sites(energy)), name) if bill else None
            return found

        return value

    headings = {"datacenter_g": "data center (gCO2e)", "robots_g": "robots (gCO2e)", "total_g": "gCO2e"}
    return [Column(*each, 1, grams(each[0])) for each in headings.items()] if has_carbon(energy) else []


def arm_columns(energy: Energy, lists: Sequence[PriceList], seen: Seen | None = None) -> list[Column]:
    """All that a comparison of arms tells, in the order of its tables; unseen tasks apart where `seen` is told."""
    return [
        Column("rounds", "rounds", 1, rounds_sum),
        *(apart_columns(seen) if seen else []),
        Column("success", "learned (%)", 0.01, lambda run: 1 - failures(run) / len(task_stages(run)), counts=False),
        Column("zero_shot", "zero-shot (%)", 0.01, zero_shot_share, counts=False),
        *cause_columns(energy, [cause for cause in CAUSES if cause in PAPER_CAUSES or _acting(energy).get(cause.key)]),
        *phase_columns(energy),
        *site_columns(energy),
        total_column(literal, energy, "E (kJ)"),
        *(total_column(each, energy, f"E (kJ), {each.label}") for each in own_lists(lists)),
        Column("bits", "Gbit", 1e9, lambda run: BITS_PER_BYTE * moved_bytes(run)),
        MOTIONS,
        *carbon_columns(energy),
    ]


def _acting(energy: Energy) -> dict[str, float]:
    """What is paid for a robot's body, by the keys of the causes."""
    return {"acting": energy.motion_j, "evaluating": energy.motion_j + energy.forward_j}


def _phase_j(energy: Energy, phase: str, run: list[Fact]) -> float | None:
    bill = priced(run, energy, literal)
    return getattr(bill, phase).total_j if bill else None
