"""What `summary.json` holds: results, joules, grams and bytes of each arm, from a run's facts. Pure; no files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any, Literal

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.joules import JoulesRow
from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.battery import lives
from jouleswarm.energy.bill import Bill, Cost, Joules, cause_parts, causes_of, parts, site_parts
from jouleswarm.energy.carbon import at_sites, carbon, has_carbon
from jouleswarm.energy.facts import Counts, Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, is_whole, own_lists, price, price_lists, with_beta
from jouleswarm.energy.published import published
from jouleswarm.runs.answer import answer_of
from jouleswarm.runs.arm_facts import arm_facts
from jouleswarm.runs.conservation import conservation
from jouleswarm.runs.facts import meta_rounds, task_results, zero_shot_share
from jouleswarm.runs.lost_work import lost_motions, lost_work
from jouleswarm.runs.measured import by_role
from jouleswarm.runs.seconds import seconds_parts
from jouleswarm.runs.traffic import metered_by, traffic

SCHEMA = 2
"""Version of the run directory. 1 knew two arms; 2 has an arm for each method and meta-model, and costs by cause."""

_TOLD = ("ml_learning", "ml_communication", "fl_learning", "fl_communication", "total")
"""Of a bill's parts; the phases' own sums are left to the reader."""


def summarise(
    scenario: Scenario,
    rows: Sequence[RoundRow],
    meter_rows: Sequence[MeterRow],
    tasks: Iterable[int] | None = None,
    *,
    work_rows: Iterable[WorkRow] = (),
    joules_rows: Sequence[JoulesRow] = (),
    status: Literal["complete", "interrupted", "failed"] = "complete",
    source: str = "",
) -> dict[str, Any]:
    """`summary.json` of a run, as plain data; `source`: whose counters feed the bill, in words.

    Joules follow the scenario's own constants. Without any meter row the joules that need bytes are null.
    """
    wanted = list(scenario.clusters if tasks is None else tasks)
    lost, balance = lost_work(scenario, rows, work_rows), conservation(meter_rows)
    own = own_lists(price_lists(scenario))
    return {
        "seed": scenario.seed,
        "t0": max((meta_rounds(rows, arm) for arm in scenario.arm_names), default=0),
        "status": status,
        "metered_by": metered_by(meter_rows),
        "counters": source,
        "counters_fit": None if balance is None else not balance.broken,
        "arms": {arm.name: _arm_summary(scenario, rows, meter_rows, lost, arm, wanted, own) for arm in scenario.arms},
        **_answer(scenario, rows, meter_rows, lost, wanted, status),
        "shared_control": traffic(meter_rows, topics.SHARED, Link.CONTROL)._asdict(),
        **({"measured_j": by_role(joules_rows)} if joules_rows else {}),
    }


def _answer(
    scenario: Scenario,
    rows: Sequence[RoundRow],
    meter_rows: Sequence[MeterRow],
    lost: Sequence[WorkRow],
    tasks: list[int],
    status: str,
) -> dict[str, Any]:
    """What the run says first. A price list of the user's that fails must not take the run with it."""
    facts = {arm: arm_facts(scenario, rows, meter_rows, arm, lost=lost) for arm in scenario.arm_names}
    results = {arm: task_results(scenario, rows, arm, tasks) for arm in scenario.arm_names}
    balance = conservation(meter_rows)
    try:
        trusted, lists = balance is None or not balance.broken, price_lists(scenario)
        found = answer_of(scenario, facts, results, scenario.energy, lists, status=status, trusted=trusted)
    except ConfigurationError as error:
        return {"answer": {"error": str(error)}}
    return {"answer": found.document}


def bill_parts(priced: Bill | None, metered: bool) -> dict[str, Joules] | None:
    """A bill under the names of `summary.json`; unmetered communication is not known, not free."""
    return None if priced is None else {name: parts(priced, metered)[name] for name in _TOLD}


def carbon_parts(cost: Cost, energy: Energy, metered: bool) -> dict[str, Joules] | None:
    """Grams of CO2 equivalent by site; None where no intensity is given."""
    if not has_carbon(energy):
        return None
    if not metered:
        return {"datacenter": None, "robots": None, "total": None}
    grams = carbon(cost, energy)
    return {"datacenter": grams.datacenter_g, "robots": grams.robots_g, "total": grams.total_g}


def _by_cause(cost: Cost, metered: bool) -> dict[str, Joules]:
    spent = cause_parts(cost, metered)
    return {cause.key: spent[cause] for cause in causes_of([cost])}


def _lost_parts(done: Facts, kept: Facts, motions: int, energy: Energy) -> dict[str, Any]:
    """What was computed and is in no row, what it cost, and the literal bill without it."""
    with_it, without = literal.price(done, energy), literal.price(kept, energy)
    costs, were = with_it.both, without.both
    counts, told = (each.counts.ml + each.counts.fl for each in (done, kept))
    names = ("gradients_support", "gradients_query", "gradients_robots")
    return {
        **{name: getattr(counts, name) - getattr(told, name) for name in names},
        "motions": motions,
        "computing_datacenter_j": costs.computing_datacenter_j - were.computing_datacenter_j,
        "computing_robots_j": costs.computing_robots_j - were.computing_robots_j,
        "literal_without_j": bill_parts(without, done.metered),
    }


def _arm_summary(
    scenario: Scenario,
    rows: Sequence[RoundRow],
    meter_rows: Sequence[MeterRow],
    lost: Sequence[WorkRow],
    arm: Arm,
    tasks: list[int],
    own: Sequence[PriceList],
) -> dict[str, Any]:
    done = arm_facts(scenario, rows, meter_rows, arm.name, lost=lost)
    kept = arm_facts(scenario, rows, meter_rows, arm.name) if lost else done
    energy, metered, motions = with_beta(scenario.energy, done), done.metered, lost_motions(lost, arm.name)
    priced = literal.price(done, energy)
    held = lives(done, energy) if energy.has_battery else {}
    results = task_results(scenario, rows, arm.name, tasks)
    return {
        "method": arm.method,
        "t0": done.t0,
        "tasks": [asdict(result) for result in results],
        "zero_shot_share": zero_shot_share(results) if results else None,
        "counts": {"ml": _counts(done.counts.ml), "fl": _counts(done.counts.fl)},
        "energy_j": {
            "literal": bill_parts(priced, metered),
            "published": bill_parts(published.price(done, energy), is_whole(published, done)),
            "by_cause": _by_cause(priced.both, metered),
            "by_site": site_parts(priced.both, metered),
            **{each.name: _own_bill(each, done, energy) for each in own},
        },
        "carbon_g": carbon_parts(priced.both, at_sites(energy, done), metered),
        "seconds": seconds_parts(done, energy),
        **({"battery": {str(robot): each._asdict() for robot, each in held.items()}} if held else {}),
        **({"lost_work": _lost_parts(done, kept, motions, energy)} if done.counts != kept.counts or motions else {}),
        "bytes": {link.value: traffic(meter_rows, arm.name, link)._asdict() for link in Link},
    }


def _counts(counts: Counts) -> dict[str, float]:
    """Motions of a run are in its work, not in its sums."""
    return {name: value for name, value in asdict(counts).items() if not name.endswith("motions")}


def _own_bill(prices: PriceList, facts: Facts, energy: Energy) -> dict[str, Any] | None:
    """By a list of the user's own; one that fails at the end of a long run must not take the run with it."""
    try:
        priced = price(prices, facts, energy)
    except ConfigurationError as error:
        return {"error": str(error)}
    if priced is None:
        return None
    cost, metered = priced.both, facts.metered
    return {
        **(bill_parts(priced, metered) or {}),
        "by_cause": _by_cause(cost, metered),
        "by_site": site_parts(cost, metered),
        **({"carbon_g": grams} if (grams := carbon_parts(cost, at_sites(energy, facts), metered)) else {}),
    }
