"""The tables of a report, whatever they are shown on: one row an arm, so that any number of arms can be read."""

from __future__ import annotations

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.bill import PARTS, SITES, Cost, cause_parts, causes_of, site_parts
from jouleswarm.energy.carbon import at_sites, carbon, has_carbon
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, own_lists, price
from jouleswarm.report.arms import labels
from jouleswarm.report.format import bytes_text, grams_text, joules_text, number_text
from jouleswarm.report.measured import measured_tables
from jouleswarm.report.table import Table
from jouleswarm.report.times import battery_tables, seconds_tables
from jouleswarm.report.why import breakeven_tables, uncertain_tables
from jouleswarm.runs.arm_facts import control_facts
from jouleswarm.runs.columns import NOT_DEFINED, Column, bills, columns, telling_lists
from jouleswarm.runs.facts import path_error, zero_shot_share
from jouleswarm.runs.lost_work import lost_motions
from jouleswarm.runs.run import Run
from jouleswarm.runs.traffic import traffic

NOT_LEARNED = "×"


def report_tables(run: Run, energy: Energy) -> list[Table]:
    """All tables of a run but those that an arm has of its own, as `energy_table`; what it cost comes first."""
    return [
        totals_table(run, energy),
        *causes_tables(run, energy),
        *sites_tables(run, energy),
        *lost_tables(run, energy),
        *measured_tables(run),
        *seconds_tables(run, energy),
        *battery_tables(run, energy),
        *breakeven_tables(run, energy),
        *uncertain_tables(run, energy),
        rounds_table(run),
        rewards_table(run),
        bytes_table(run, energy),
    ]


def rounds_table(run: Run) -> Table:
    """Rounds of meta-learning and of each task."""
    rows = []
    for arm, name in labels(run.scenario).items():
        found = run.results[arm]
        cells = [f"{result.rounds}{'' if result.learned else ' ' + NOT_LEARNED}" for result in found]
        measures = ([result.full_window for result in found], [result.partial_window for result in found])
        sums = ["-" if None in each else f"{sum(filter(None, each))}" for each in measures]
        share = f"{100 * zero_shot_share(found):.0f}%"
        rows.append([name, str(run.t0[arm]), *cells, f"{sum(run.rounds(arm).values()):g}", *sums, share])
    headings = ["arm", "t0", *(f"t_{task}" for task in run.scenario.clusters), "sum of t_i"]
    headings += ["by full window", "by partial window", "at t_i = 0"]
    return Table(f"Rounds until each task was learned ({NOT_LEARNED}: it was not)", headings, rows)


def rewards_table(run: Run) -> Table:
    """Running reward of each task, and path error where there is a path."""
    results = {name: run.results[arm] for arm, name in labels(run.scenario).items()}
    has_path = any(each.rmse_m is not None for found in results.values() for each in found)
    has_exit = any(each.missed_exits is not None for found in results.values() for each in found)
    rows = []
    for name, found in results.items():
        errors = [f"/{number_text(each.rmse_m, 2)}" if has_path else "" for each in found]
        cells = [number_text(each.reward) + error for each, error in zip(found, errors, strict=True)]
        missed = [f"{each.task}: {each.missed_exits} of {each.episodes}" for each in found if each.missed_exits]
        off = "/".join(number_text(each, 2) for each in path_error(found) or (None, None))
        rows.append([name, *cells, *[off] * has_path, *([", ".join(missed) or "none"] if has_exit else [])])
    headings = ["arm", *(f"task {task}" for task in run.scenario.clusters)]
    headings += [*["RMSE, mean/worst task"] * has_path, *["missed exits"] * has_exit]
    return Table("At the end: running reward R" + "/path error (RMSE in m)" * has_path, headings, rows)


def totals_table(run: Run, energy: Energy) -> Table:
    """E of every arm, one column a way to know it."""
    held = {name: columns(run, arm, energy) for arm, name in labels(run.scenario).items()}
    rows = [[name, *(_total_text(column) for column in found)] for name, found in held.items()]
    headings = ["arm", *(column.label for column in next(iter(held.values())))]
    headings[1] += " (its t0)"
    return Table("E, eq. (12), by each way to know it", headings, rows)


def causes_tables(run: Run, energy: Energy) -> list[Table]:
    """What the bill of every arm was spent on, both phases together; a table a price list that tells."""
    tables = []
    for heading, prices in telling_lists(run).items():
        costs, rows = _costs(run, energy, prices), []
        causes = causes_of(costs.values())
        for arm, name in labels(run.scenario).items():
            cost, metered = costs[arm], run.facts[arm].metered
            spent = cause_parts(cost, metered)
            total = cost.total_j if cost and metered else None
            rows.append([name, *(joules_text(spent[cause]) for cause in causes), joules_text(total)])
        headings = ["arm", *(cause.label for cause in causes), PARTS["total"]]
        tables.append(Table(f"{heading}: E by cause", headings, rows))
    return tables


def sites_tables(run: Run, energy: Energy) -> list[Table]:
    """Who pays the bill of every arm, as `causes_tables`; grams of CO2 equivalent too, where an intensity is given."""
    shown, tables = has_carbon(energy), []
    for heading, prices in telling_lists(run).items():
        rows = []
        for arm, cost in _costs(run, energy, prices).items():
            metered = run.facts[arm].metered
            cells = [joules_text(joules) for joules in site_parts(cost, metered).values()]
            if shown:
                grams = carbon(cost, at_sites(energy, run.facts[arm])) if cost and metered else None
                known = (grams.datacenter_g, grams.robots_g, grams.total_g) if grams else (None, None, None)
                cells += [grams_text(value) for value in known]
            rows.append([labels(run.scenario)[arm], *cells])
        headings = ["arm", *SITES.values()]
        if shown:
            headings += [f"gCO2e, {name}" for name in (*SITES.values(), "both")]
        tables.append(Table(f"{heading}: E{' and gCO2e' if shown else ''} by site", headings, rows))
    return tables


def energy_table(run: Run, arm: str, energy: Energy) -> Table:
    """An arm's energy by stage and cause, one column a way to know it."""
    held = columns(run, arm, energy)
    rows = [[name, *(joules_text(column.joules[part]) for column in held)] for part, name in PARTS.items()]
    headings = [f"{column.label} ({column.about})" if column.about else column.label for column in held]
    styles = {place: "bold" for place, part in enumerate(PARTS) if part in ("ml", "fl", "total")}
    return Table(f"Energy: {labels(run.scenario)[arm]}", ["", *headings], rows, styles=styles)


def bytes_table(run: Run, energy: Energy) -> Table:
    """What was delivered over each link class that was used, and what carrying it cost in protocol bytes.

    Control and telemetry are in no bill: what each price list would take for them stands beside.
    """
    rows, lists = [], [*([literal] if literal in run.price_lists else []), *own_lists(run.price_lists)]
    for arm, name in labels(run.scenario).items():
        for link in Link:
            found = traffic(run.meter_rows, arm, link)
            if not found.messages:
                continue
            overhead = "-" if found.overhead is None else f"{100 * found.overhead:.3f}%"
            would = [""] * len(lists)
            if link == Link.CONTROL:
                control = control_facts(run.facts[arm], run.meter_rows)
                priced = (price(each, control, energy) for each in lists)
                would = [joules_text(bill.total_j if bill else None) for bill in priced]
            sizes = (bytes_text(found.payload), bytes_text(found.packet))
            rows.append([f"{name}: {link.value}", f"{found.messages:,}", *sizes, overhead, *would])
    costs = ["would cost" if each is literal else f"would cost, {each.label}" for each in lists]
    headings = ["link", "messages", "payload", "whole packets", "overhead", *costs]
    return Table("Bytes delivered by link class", headings, rows)


def lost_tables(run: Run, energy: Energy) -> list[Table]:
    """What faults have cost each arm in computing, by each list as `causes_tables`; none if nothing was in vain."""
    if not run.lost:
        return []
    headings = ["arm", "by robots", "by center", "motions", "J, robots", "J, center", "E with", "E without"]
    title = "Done and not kept, because something had failed: gradients, motions, joules"
    tables = []
    for heading, prices in telling_lists(run).items():
        rows = []
        for arm, name in labels(run.scenario).items():
            facts = (run.facts[arm], run.kept_facts[arm])
            done, kept = (each.counts.ml + each.counts.fl for each in facts)
            center, before = (each.gradients_support + each.gradients_query for each in (done, kept))
            counted = (done.gradients_robots - kept.gradients_robots, center - before, lost_motions(run.lost, arm))
            rows.append([name, *(f"{number:g}" for number in counted), *_lost_joules(*facts, energy, prices)])
        tables.append(Table(f"{title} ({heading[0].lower()}{heading[1:]})", headings, rows))
    return tables


def _lost_joules(done: Facts, kept: Facts, energy: Energy, prices: PriceList) -> list[str]:
    """Computing in vain by site, and E with it and without."""
    with_it, without = price(prices, done, energy), price(prices, kept, energy)
    if with_it is None or without is None:
        return [joules_text(None)] * 4
    spent, were = with_it.both, without.both
    computing = (
        spent.computing_robots_j - were.computing_robots_j,
        spent.computing_datacenter_j - were.computing_datacenter_j,
    )
    totals = [bill.total_j if done.metered else None for bill in (with_it, without)]
    return [joules_text(joules) for joules in (*computing, *totals)]


def _costs(run: Run, energy: Energy, prices: PriceList) -> dict[str, Cost | None]:
    return {arm: bill.both if bill else None for arm, bill in bills(run, energy, prices).items()}


def _total_text(column: Column) -> str:
    text = joules_text(column.joules["total"])
    if column.about == NOT_DEFINED:
        return NOT_DEFINED
    return f"{text} ({column.about.removeprefix('t0 = ')})" if column.about else text
