"""The tables of a report, whatever they are shown on: one row an arm, so that any number of arms can be read."""

from __future__ import annotations

from jouleswarm.common.scenario.sections import Energy
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.carbon import carbon, has_carbon
from jouleswarm.energy.equations import bill
from jouleswarm.report.arms import labels
from jouleswarm.report.format import TextTable, bytes_text, grams_text, joules_text, number_text
from jouleswarm.runs.beta import with_beta
from jouleswarm.runs.columns import NOT_DEFINED, PARTS, Column, columns, control_j, measured_bill
from jouleswarm.runs.facts import arm_counts
from jouleswarm.runs.lost_work import lost_motions
from jouleswarm.runs.run import Run
from jouleswarm.runs.summary import cause_parts, lost_parts, site_parts
from jouleswarm.runs.traffic import traffic

PART_NAMES = {
    "ml_learning": "meta-learning: computing",
    "ml_communication": "meta-learning: traffic",
    "ml": "E_ML, eq. (8)",
    "fl_learning": "tasks: computing",
    "fl_communication": "tasks: traffic",
    "fl": "E_FL, eq. (10)",
    "total": "E, eq. (12)",
}
CAUSE_NAMES = {
    "computing_datacenter": "computing, data center",
    "computing_robots": "computing, robots",
    "uplink": "uplink",
    "downlink": "downlink",
    "sidelink": "sidelinks",
}
SITE_NAMES = {"datacenter": "data center", "robots": "robots"}
NOT_LEARNED = "×"


def rounds_table(run: Run) -> TextTable:
    """Rounds of meta-learning and of each task."""
    rows = []
    for arm, name in labels(run.scenario).items():
        found = run.results[arm]
        cells = [f"{result.rounds}{'' if result.learned else ' ' + NOT_LEARNED}" for result in found]
        rows.append([name, str(run.t0[arm]), *cells, f"{sum(run.rounds(arm).values()):g}"])
    headings = ["arm", "t0", *(f"t_{task}" for task in run.scenario.clusters), "sum of t_i"]
    return TextTable(f"Rounds until each task was learned ({NOT_LEARNED}: it was not)", headings, rows)


def rewards_table(run: Run) -> TextTable:
    """Running reward of each task, and path error where there is a path."""
    results = {name: run.results[arm] for arm, name in labels(run.scenario).items()}
    has_path = any(each.rmse_m is not None for found in results.values() for each in found)
    rows = []
    for name, found in results.items():
        errors = [f"/{number_text(each.rmse_m, 2)}" if has_path else "" for each in found]
        cells = [number_text(each.reward) + error for each, error in zip(found, errors, strict=True)]
        rows.append([name, *cells])
    headings = ["arm", *(f"task {task}" for task in run.scenario.clusters)]
    return TextTable("At the end: running reward R" + "/path error (RMSE in m)" * has_path, headings, rows)


def totals_table(run: Run, energy: Energy) -> TextTable:
    """E of every arm, one column a way to know it."""
    held = {name: columns(run, arm, energy) for arm, name in labels(run.scenario).items()}
    rows = [[name, *(_total_text(column) for column in found)] for name, found in held.items()]
    headings = ["arm", *(column.label for column in next(iter(held.values())))]
    headings[1] += " (its t0)"
    return TextTable("E, eq. (12), by each way to know it", headings, rows)


def causes_table(run: Run, energy: Energy) -> TextTable:
    """What the measured bill of every arm was spent on, both stages together."""
    metered = bool(run.meter_rows)
    rows = []
    for arm, name in labels(run.scenario).items():
        cost = measured_bill(run, arm, energy).both
        parts = cause_parts(cost, metered) | {"total": cost.total_j if metered else None}
        rows.append([name, *(joules_text(joules) for joules in parts.values())])
    return TextTable("Measured payload: E by cause", ["arm", *CAUSE_NAMES.values(), PART_NAMES["total"]], rows)


def sites_table(run: Run, energy: Energy) -> TextTable:
    """Who pays the measured bill of every arm; grams of CO2 equivalent beside, where an intensity is given."""
    metered, shown = bool(run.meter_rows), has_carbon(energy)
    rows = []
    for arm, name in labels(run.scenario).items():
        cost = measured_bill(run, arm, energy).both
        cells = [joules_text(joules) for joules in site_parts(cost, metered).values()]
        if shown:
            grams = carbon(cost, energy)
            known = (grams.datacenter_g, grams.robots_g, grams.total_g)
            cells += [grams_text(value if metered else None) for value in known]
        rows.append([name, *cells])
    headings = ["arm", *SITE_NAMES.values()]
    if shown:
        headings += [f"gCO2e, {name}" for name in (*SITE_NAMES.values(), "both")]
    return TextTable(f"Measured payload: E{' and gCO2e' if shown else ''} by site", headings, rows)


def energy_table(run: Run, arm: str, energy: Energy) -> TextTable:
    """An arm's energy by stage and cause, one column a way to know it."""
    held = columns(run, arm, energy)
    rows = [[PART_NAMES[part], *(joules_text(column.joules[part]) for column in held)] for part in PARTS]
    headings = [f"{column.label} ({column.about})" if column.about else column.label for column in held]
    strong = frozenset(PARTS.index(part) for part in ("ml", "fl", "total"))
    return TextTable(f"Energy: {labels(run.scenario)[arm]}", ["", *headings], rows, strong)


def bytes_table(run: Run, energy: Energy) -> TextTable:
    """What was delivered over each link class that was used, and what carrying it cost in protocol bytes."""
    rows = []
    for arm, name in labels(run.scenario).items():
        for link in Link:
            found = traffic(run.meter_rows, arm, link)
            if not found.messages:
                continue
            overhead = "-" if found.overhead is None else f"{100 * found.overhead:.3f}%"
            price = joules_text(control_j(run, arm, energy)) if link == Link.CONTROL else ""
            sizes = (bytes_text(found.payload), bytes_text(found.packet))
            rows.append([f"{name}: {link.value}", f"{found.messages:,}", *sizes, overhead, price])
    headings = ["link", "messages", "payload", "whole packets", "overhead", "would cost"]
    return TextTable("Bytes delivered by link class", headings, rows)


def lost_table(run: Run, energy: Energy) -> TextTable | None:
    """What faults have cost each arm in computing; None where nothing was done in vain."""
    rows, metered = [], bool(run.meter_rows)
    for arm, name in labels(run.scenario).items():
        priced = with_beta(energy, run.rows, arm)
        counts, kept = (arm_counts(run.rows, run.meter_rows, arm, lost=each) for each in (run.lost, ()))
        lost = lost_parts(counts, kept, lost_motions(run.lost, arm), priced, metered)
        center = lost["gradients_support"] + lost["gradients_query"]
        done = [f"{number:g}" for number in (lost["gradients_robots"], center, lost["motions"])]
        joules = (
            lost["computing_robots_j"],
            lost["computing_datacenter_j"],
            bill(counts, priced).total_j if metered else None,
            lost["literal_without_j"]["total"],
        )
        rows.append([name, *done, *(joules_text(each) for each in joules)])
    if not run.lost:
        return None
    headings = ["arm", "by robots", "by center", "motions", "J, robots", "J, center", "E with", "E without"]
    title = "Done and not kept, because something had failed: gradients, motions, joules (measured payload)"
    return TextTable(title, headings, rows)


def _total_text(column: Column) -> str:
    text = joules_text(column.joules["total"])
    if column.about == NOT_DEFINED:
        return NOT_DEFINED
    return f"{text} ({column.about.removeprefix('t0 = ')})" if column.about else text
