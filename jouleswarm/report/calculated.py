"""`jouleswarm bill`: the bill of anybody's own counts, for the terminal and as plain data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

from rich.console import Console

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import Override, energy_file
from jouleswarm.common.scenario.tariff import Tariff, read_tariff
from jouleswarm.energy.bill import SITES, Bill, cause_parts, causes_of, parts, site_parts
from jouleswarm.energy.breakeven import savings, tasks_to_pay
from jouleswarm.energy.calculator import ALONE, facts_of, robots_of, seen_of
from jouleswarm.energy.carbon import at_sites, carbon, has_carbon
from jouleswarm.energy.facts import STAGE, Counts, Facts
from jouleswarm.energy.metered import Measured, measured
from jouleswarm.energy.prices import PriceList, price, price_lists, with_beta
from jouleswarm.energy.published import published
from jouleswarm.energy.rows import Row, read_rows
from jouleswarm.metering.metered import is_metered, load_metered
from jouleswarm.report.format import grams_text, joules_text
from jouleswarm.report.table import Cell, Table, show
from jouleswarm.report.times import times_tables
from jouleswarm.report.why import ranges_tables
from jouleswarm.runs.seconds import seconds_parts

_SUMS = ("ml", "fl", "total")


@dataclass(frozen=True)
class Calculated:
    """Facts of each arm, and its bills."""

    tariff: Tariff
    facts: Mapping[str, Facts]
    bills: Mapping[PriceList, Mapping[str, Bill | None]]
    """By the lists that are defined for any arm."""

    seen: Mapping[str, Sequence[int]]
    """Arm -> tasks that its stage before was learned from."""

    measured: Sequence[Measured] = ()
    """Beside the bills, and never in them."""

    @property
    def break_even_tasks(self) -> Iterator[tuple[PriceList, str, str, float]]:
        """(list, arm with a stage before, arm without, M*) of arms that learned the same tasks, told one by one."""
        whole = {arm: each for arm, each in self.facts.items() if ("fl", STAGE) not in each.parts}
        staged = [arm for arm, each in whole.items() if each.counts.ml != Counts()]
        for prices, arm, other in product(self.bills, staged, whole):
            ours, plain = whole[arm], whole[other]
            if other not in staged and ours.rounds.keys() == plain.rounds.keys():
                found = savings(ours, plain, self.seen[arm], self.tariff.energy, prices)
                if found is not None:
                    yield prices, arm, other, tasks_to_pay(found)


def calculate(counts: Any, energy: Path | None = None, changes: Iterable[Override] = ()) -> Calculated:
    """Price rows (see `energy.rows.read_rows`) at the constants of a file, or else at the paper's, with changes; a
    meter's run directory at its own.

    Raises:
        ConfigurationError: one line that says what is wrong and where.
    """
    if isinstance(counts, str | Path) and is_metered(Path(counts)):
        metered = load_metered(Path(counts))
        if not metered.bill_rows:
            raise ConfigurationError(f"{counts}: nothing has passed the meter that a rule prices")
        return calculated(metered.bill_rows, metered.priced([*energy_file(energy), *changes])[0])
    rows = read_rows(counts)
    return calculated(rows, read_tariff(energy, changes, robots_of(rows)))


def calculated(rows: Sequence[Row], tariff: Tariff) -> Calculated:
    """The same of rows that have been read, at prices that have been read.

    Raises:
        ConfigurationError: one line that says what is wrong and where.
    """
    facts = facts_of(rows, by_robot=tariff.is_by_robot)
    bills = {each: {arm: price(each, one, tariff.energy) for arm, one in facts.items()} for each in price_lists(tariff)}
    told = {each: held for each, held in bills.items() if any(held.values())}
    return Calculated(tariff, facts, told, {arm: seen_of(rows, arm) for arm in facts}, measured(rows))


def print_calculated(found: Calculated, console: Console | None = None) -> None:
    """Tables of each list, with intervals where constants are ranges, and break-even."""
    console = console or Console()
    for table in calculated_tables(found):
        show(table, console)
    for prices, arm, other, tasks in found.break_even_tasks:
        told = "never pays" if math.isinf(tasks) else f"pays with more than {tasks:.4g} tasks"
        console.print(f"{arm} against {other}: {told} ({prices.label})", style="bold", highlight=False)


def calculated_tables(found: Calculated) -> list[Table]:
    """Of each list, with intervals where constants are ranges."""
    plain = next((arm for arm, facts in found.facts.items() if facts.counts.ml == Counts()), next(iter(found.facts)))
    names, energy = {arm: arm for arm in found.facts}, found.tariff.energy
    lists = [each for each in found.bills if each != published]  # which follows none of the constants
    ranges = [table for each in lists for table in ranges_tables(found.facts, names, energy, each, plain)]
    return [*_tables(found), *ranges]


def document(found: Calculated) -> dict[str, Any]:
    """The same as plain data; joules, grams, and null for what is not known or never."""
    arms: dict[str, Any] = {}
    for arm, facts in found.facts.items():
        energy_j = {}
        for prices, bills in found.bills.items():
            if bill := bills[arm]:
                causes = {cause.key: joules for cause, joules in cause_parts(bill.both).items()}
                energy_j[prices.name] = parts(bill) | {"by_cause": causes, "by_site": site_parts(bill.both)}
                if has_carbon(found.tariff.energy):
                    energy_j[prices.name]["carbon_g"] = carbon(bill, at_sites(found.tariff.energy, facts))._asdict()
        arms[arm] = {"t0": facts.t0, "rounds": dict(facts.rounds), "counts": asdict(facts.counts), "energy_j": energy_j}
        if found.tariff.energy.tells_time:
            arms[arm]["seconds"] = seconds_parts(facts, with_beta(found.tariff.energy, facts))
    even: dict[str, Any] = {}
    for prices, arm, other, tasks in found.break_even_tasks:
        even.setdefault(prices.name, {}).setdefault(arm, {})[other] = tasks if math.isfinite(tasks) else None
    constants = found.tariff.energy.model_dump(mode="json", exclude_defaults=True)
    beside = {"measured": [each._asdict() for each in found.measured]} if found.measured else {}
    return {"energy": constants, "arms": arms, "break_even_tasks": even, **beside}


def _tables(found: Calculated) -> Iterator[Table]:
    """Two a list: by phase and who pays, and by cause; what a list does not tell is left out."""
    for prices, bills in found.bills.items():
        costs = {arm: bill.both if bill else None for arm, bill in bills.items()}
        tells = any(cost and not cost.untold_j for cost in costs.values())
        grams, causes = tells and has_carbon(found.tariff.energy), causes_of(costs.values())
        sums, spent = [], []
        for arm, cost in costs.items():
            facts = found.facts[arm]
            told = [parts(bills[arm])[part] for part in _SUMS] + [*site_parts(cost).values()] * tells
            cells = [joules_text(each) for each in told]
            if grams:
                here = at_sites(found.tariff.energy, facts)
                cells += [grams_text(each) for each in (carbon(cost, here) if cost else (None, None))]
            sums.append([arm, f"{facts.t0:g}", f"{sum(facts.rounds.values()):g}", *cells])
            spent.append([arm, *(joules_text(cause_parts(cost)[cause]) for cause in causes)])
        sites = [*SITES.values()] * tells + [f"gCO2e, {site}" for site in SITES.values()] * grams
        title = f"{prices.label[0].upper()}{prices.label[1:]}"
        yield Table(f"{title}: by phase and site", ["arm", "t0", "rounds", "E_ML", "E_FL", "E", *sites], sums)
        if tells:
            yield Table(f"{title}: by cause", ["arm", *(cause.heading for cause in causes)], spent)
    yield from times_tables(found.facts, {arm: arm for arm in found.facts}, found.tariff.energy)
    if found.measured:
        yield _measured_table(found.measured)


def _measured_table(rows: Sequence[Measured]) -> Table:
    hows = list(dict.fromkeys(how for row in rows for how in row.joules))
    cells: list[list[Cell]] = [
        [
            f"{row.arm or ALONE}, {SITES[row.site]}: {row.activity or 'all else'}",
            *(row.seconds, row.cpu_s),
            *(joules_text(row.joules.get(how)) for how in hows),
        ]
        for row in rows
    ]
    headings = ["arm, site: activity", "seconds", "CPU seconds", *(f"joules, {how}" for how in hows)]
    return Table("Measured beside it, in no bill", headings, cells)
