"""The energy columns that a report holds side by side: what the paper prints, and price lists over a run's facts."""

from __future__ import annotations

from typing import NamedTuple

from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill, Joules, parts
from jouleswarm.energy.closed_form import TABLE_I, RoundSizes
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, is_whole, own_lists, price
from jouleswarm.energy.published import published
from jouleswarm.runs.arm_facts import in_closed_form
from jouleswarm.runs.paper import is_papers_scenario, printed_total
from jouleswarm.runs.run import Run
from jouleswarm.runs.sizes import scenario_sizes

NOT_DEFINED = "not defined here"
"""`about` of a column whose price list implies nothing for this arm."""

COUNTED = "counted payload"
"""The column of the equations over what was counted, without MQTT's own bytes."""


class Column(NamedTuple):
    """One column of the energy table; `about` tells what it holds for this arm where that is not the run's own."""

    label: str
    joules: dict[str, Joules]
    """By `energy.bill.PARTS`."""
    about: str = ""


def columns(run: Run, arm: str, energy: Energy) -> list[Column]:
    """The energy columns of one arm: as printed, the published prices, the equations in four views, a user's lists."""
    facts, lists = run.facts[arm], run.price_lists
    found = [_printed(run, arm, energy)]
    if published in lists:
        found.append(_column(published.label, published, facts, energy))
    if literal in lists:
        views = {
            "Table I sizes": closed_facts(run, arm, TABLE_I),
            "scenario sizes": closed_facts(run, arm),
            COUNTED: facts,
            "counted packets": run.packet_facts[arm],
        }
        found += [_column(label, literal, view, energy) for label, view in views.items()]
    return found + [_column(each.label, each, facts, energy) for each in own_lists(lists)]


def closed_facts(run: Run, arm: str, sizes: RoundSizes | None = None) -> Facts:
    """An arm's facts from its round numbers alone."""
    facts = run.facts[arm]
    alone = run.scenario.method(facts.method).partners == "nobody"
    rounds = run.mean_rounds(arm) if alone else run.rounds(arm)
    return in_closed_form(facts, run.scenario, rounds, sizes or scenario_sizes(run.scenario))


def telling_lists(run: Run) -> dict[str, PriceList]:
    """The lists that tell what joules were spent on and who pays, by what their tables and panels are headed with."""
    ours = {COUNTED.capitalize(): literal} if literal in run.price_lists else {}
    return ours | {each.label: each for each in own_lists(run.price_lists)}


def bills(run: Run, energy: Energy, prices: PriceList) -> dict[str, Bill | None]:
    """Each arm's bill by a list."""
    return {arm: price(prices, facts, energy) for arm, facts in run.facts.items()}


def _column(label: str, prices: PriceList, facts: Facts, energy: Energy) -> Column:
    bill = price(prices, facts, energy)
    return Column(label, parts(bill, is_whole(prices, facts)), "" if bill else NOT_DEFINED)


def _printed(run: Run, arm: str, energy: Energy) -> Column:
    method, t0 = method_of(arm), run.t0[arm]
    is_papers = is_papers_scenario(run.scenario, energy)
    printed = printed_total(method, t0, energy.ul_bit_per_j, energy.sl_bit_per_j) if is_papers else None
    about = f"t0 = {printed.t0}" if printed and printed.t0 else ""
    told = {"ml": printed.ml_j, "total": printed.total_j} if printed else {}
    return Column("paper", parts(None) | told, about)
