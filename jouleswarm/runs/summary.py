"""What `summary.json` holds: results, joules, grams and bytes of each arm, from a run's facts. Pure; no files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any, Literal

from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.bill import Bill, Cost, PublishedBill, StageCounts
from jouleswarm.energy.carbon import carbon, has_carbon
from jouleswarm.energy.equations import bill
from jouleswarm.runs.beta import with_beta
from jouleswarm.runs.conservation import conservation
from jouleswarm.runs.facts import arm_counts, meta_rounds, task_results
from jouleswarm.runs.lost_work import lost_motions, lost_work
from jouleswarm.runs.paper import published_here
from jouleswarm.runs.traffic import metered_by, traffic

SCHEMA = 2
"""Version of the run directory. 1 knew two arms; 2 has an arm for each method and meta-model, and costs by cause."""

Known = float | None


def summarise(
    scenario: Scenario,
    rows: Sequence[RoundRow],
    meter_rows: Sequence[MeterRow],
    tasks: Iterable[int] | None = None,
    *,
    work_rows: Iterable[WorkRow] = (),
    status: Literal["complete", "interrupted", "failed"] = "complete",
    source: str = "",
) -> dict[str, Any]:
    """`summary.json` of a run, as plain data; `source`: whose counters feed the bill, in words.

    Joules follow the scenario's own constants. Without any meter row the joules that need bytes are null.
    """
    wanted = list(scenario.clusters if tasks is None else tasks)
    lost, balance = lost_work(scenario, rows, work_rows), conservation(meter_rows)
    return {
        "seed": scenario.seed,
        "t0": max((meta_rounds(rows, arm) for arm in scenario.arm_names), default=0),
        "status": status,
        "metered_by": metered_by(meter_rows),
        "counters": source,
        "counters_fit": None if balance is None else not balance.broken,
        "arms": {arm.name: _arm_summary(scenario, rows, meter_rows, lost, arm, wanted) for arm in scenario.arms},
        "shared_control": traffic(meter_rows, topics.SHARED, Link.CONTROL)._asdict(),
    }


def literal_parts(priced: Bill, metered: bool) -> dict[str, Known]:
    """A literal bill under the names of `summary.json`; unmetered communication is not known, not free."""
    return {
        "ml_learning": priced.ml_learning_j,
        "ml_communication": priced.ml_communication_j if metered else None,
        "fl_learning": priced.fl_learning_j,
        "fl_communication": priced.fl_communication_j if metered else None,
        "total": priced.total_j if metered else None,
    }


def published_parts(priced: PublishedBill | None) -> dict[str, Known] | None:
    """A published bill under the same names: it has no parts, but nothing is made up of nothing."""
    if priced is None:
        return None
    ml = 0.0 if priced.ml_j == 0 else None
    fl = 0.0 if priced.fl_j == 0 else None
    return {
        "ml_learning": ml,
        "ml_communication": ml,
        "fl_learning": fl,
        "fl_communication": fl,
        "total": priced.total_j,
    }


def cause_parts(cost: Cost, metered: bool) -> dict[str, Known]:
    """A cost by cause under the names of `summary.json`."""
    return {
        "computing_datacenter": cost.center_computing_j,
        "computing_robots": cost.robot_computing_j,
        "uplink": cost.uplink_j if metered else None,
        "downlink": cost.downlink_j if metered else None,
        "sidelink": cost.sidelink_j if metered else None,
    }


def site_parts(cost: Cost, metered: bool) -> dict[str, Known]:
    """A cost by the site that pays it; neither is known without its traffic."""
    return {
        "datacenter": cost.datacenter_j if metered else None,
        "robots": cost.robots_j if metered else None,
    }


def carbon_parts(cost: Cost, energy: Energy, metered: bool) -> dict[str, Known] | None:
    """Grams of CO2 equivalent by site; None where no intensity is given."""
    if not has_carbon(energy):
        return None
    if not metered:
        return {"datacenter": None, "robots": None, "total": None}
    grams = carbon(cost, energy)
    return {"datacenter": grams.datacenter_g, "robots": grams.robots_g, "total": grams.total_g}


def lost_parts(counts: StageCounts, kept: StageCounts, motions: int, energy: Energy, metered: bool) -> dict[str, Any]:
    """What was computed and is in no row, what it cost, and the literal bill without it."""
    with_it, without = bill(counts, energy), bill(kept, energy)
    done, told, costs, were = counts.ml + counts.fl, kept.ml + kept.fl, with_it.both, without.both
    names = ("gradients_support", "gradients_query", "gradients_robots")
    return {
        **{name: getattr(done, name) - getattr(told, name) for name in names},
        "motions": motions,
        "computing_datacenter_j": costs.center_computing_j - were.center_computing_j,
        "computing_robots_j": costs.robot_computing_j - were.robot_computing_j,
        "literal_without_j": literal_parts(without, metered),
    }


def _arm_summary(
    scenario: Scenario,
    rows: Sequence[RoundRow],
    meter_rows: Sequence[MeterRow],
    lost: Sequence[WorkRow],
    arm: Arm,
    tasks: list[int],
) -> dict[str, Any]:
    results = task_results(scenario, rows, arm.name, tasks)
    t0 = meta_rounds(rows, arm.name)
    counts, kept = (arm_counts(rows, meter_rows, arm.name, lost=each) for each in (lost, ()))
    energy, metered = with_beta(scenario.energy, rows, arm.name), bool(meter_rows)
    literal = bill(counts, energy)
    rounds = sum(result.rounds for result in results)
    published = published_here(arm.method, t0, rounds, scenario, scenario.energy)
    motions = lost_motions(lost, arm.name)
    return {
        "method": arm.method,
        "t0": t0,
        "tasks": [asdict(result) for result in results],
        "counts": {"ml": asdict(counts.ml), "fl": asdict(counts.fl)},
        "energy_j": {
            "literal": literal_parts(literal, metered),
            "published": published_parts(published),
            "by_cause": cause_parts(literal.both, metered),
            "by_site": site_parts(literal.both, metered),
        },
        "carbon_g": carbon_parts(literal.both, scenario.energy, metered),
        **({"lost_work": lost_parts(counts, kept, motions, energy, metered)} if counts != kept or motions else {}),
        "bytes": {link.value: traffic(meter_rows, arm.name, link)._asdict() for link in Link},
    }
