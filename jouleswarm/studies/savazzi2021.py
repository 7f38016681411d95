"""Centralized learning, FL by a server and consensus FL: where each wins, and where by country. Nothing is run.

After S. Savazzi, S. Kianoush, V. Rampa, M. Bennis, "A framework for energy and carbon footprint analysis of distributed
and federated edge learning" (PIMRC 2021, arXiv 2103.10346). docs/results.md says what is known of it and what assumed.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.crossing import Curve, Footprint, Verdict, cheaper
from jouleswarm.energy.repricing import reprice
from jouleswarm.report.table import Cell, Table, number
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.facts import read_facts
from jouleswarm.studies.kinds import Outputs, write_outputs
from jouleswarm.studies.record import RECORD, read_record
from jouleswarm.studies.savazzi2021_cases import CASES, COUNTRIES, METHODS, Case, cases, cheapest, grams, totals
from jouleswarm.studies.savazzi2021_figures import carbon_figure, winners_figure

PAIRS = (("fl", "centralized"), ("fl", "fedavg"), ("fedavg", "centralized"))
"""One that is compared with another."""
UPLINKS = (10e3, 20e3, 50e3, 100e3, 200e3, 500e3, 1000e3)
_KB = 1e3


def thresholds_csv(found: Mapping[str, Case]) -> Table:
    """Where one method costs less than another: of the mean over seeds, and the lowest and highest of single seeds.

    `along` says what is varied: E_SL at a given E_UL, E_UL where no sidelink is used, or all links alike.
    """
    rows: list[list[Cell]] = []
    for name, case in found.items():
        for one, other in PAIRS:
            for ul in UPLINKS if one == "fl" else ():
                rows.append([name, one, other, "sidelink", ul / _KB, *_cells(case, one, other, _along_sl(ul))])
            rows.append([name, one, other, "all links", None, *_cells(case, one, other, Footprint.along_both)])
    headings = ("case", "cheaper", "than", "along", "ul_kb_per_j", "where", "kb_per_j", "lowest_seed", "highest_seed")
    return Table("Thresholds", headings, rows)


def thresholds_markdown(found: Mapping[str, Case]) -> list[Table]:
    """The same for readers."""
    sidelink, alike = [], []
    for name, case in found.items():
        for ul in UPLINKS:
            told = [_told(_cells(case, *pair, _along_sl(ul))) for pair in PAIRS[:2]]
            without = METHODS[cheapest({m: f for m, f in totals(case).items() if m != "fl"}, ul, ul)]
            sidelink.append((CASES[name], f"{ul / _KB:g}", *told, without))
        alike.append((CASES[name], *(_told(_cells(case, *pair, Footprint.along_both)) for pair in PAIRS)))
    pairs = [f"{METHODS[one]} beats {METHODS[other]}" for one, other in PAIRS]
    first = Table(
        "E_SL from which consensus FL costs less (kb/J)",
        ("bytes", "E_UL (kb/J)", *pairs[:2], "cheapest without sidelinks"),
        sidelink,
        ("In brackets the lowest and the highest of single seeds. Literal prices, with gamma on the downlink.",),
    )
    return [first, Table("All links of the same efficiency (kb/J)", ("bytes", *pairs), alike)]


def bills_csv(found: Mapping[str, Case]) -> Table:
    """What thresholds come of, means over seeds: joules of computing by site, and bits of the uplink and of sidelinks.

    What goes down is in `ul_bits`, with gamma.
    """
    rows: list[tuple[Cell, ...]] = []
    for name, case in found.items():
        robots, datacenter = totals(case, 1.0, 0.0), totals(case, 0.0, 1.0)
        for method, both in totals(case).items():
            computing = (robots[method].fixed, datacenter[method].fixed)
            rows.append((name, method, *computing, both.ul_bits, both.sl_bits))
    return Table("Bills", ("case", "method", "robots_j", "datacenter_j", "ul_bits", "sl_bits"), rows)


def carbon_csv(found: Mapping[str, Case], energy: Energy) -> Table:
    """gCO2e by the countries of robots and data center at the scenario's efficiencies, and where consensus emits less
    than each of the others as E_SL varies.
    """
    rows: list[list[Cell]] = []
    ul, sl = energy.ul_bit_per_j, energy.sl_bit_per_j
    for name, case in found.items():
        for robots, datacenter in itertools.product(COUNTRIES, repeat=2):
            held = totals(case, *grams(robots, datacenter))
            sides = [_cell(cheaper(held["fl"].along_sl(ul), held[other].along_sl(ul))) for _, other in PAIRS[:2]]
            emitted = [each.at(ul, sl) for each in held.values()]
            rows.append([name, robots, datacenter, *emitted, cheapest(held, ul, sl), *sides[0], *sides[1]])
    emitted_g = [f"{method}_g" for method in METHODS]
    where = [f"{what}_{other}" for _, other in PAIRS[:2] for what in ("where_less_than", "kb_per_j")]
    return Table("Carbon", ("case", "robots", "datacenter", *emitted_g, "least", *where), rows)


def carbon_markdown(found: Mapping[str, Case], energy: Energy) -> Table:
    """The same for readers, of Table I's sizes."""
    rows = carbon_csv({"paper": found["paper"]}, energy).rows
    shown = [
        (*row[1:6], METHODS[str(row[6])], *(_told((*row[at : at + 2], None, None)) for at in (7, 9))) for row in rows
    ]
    at = f"{energy.ul_bit_per_j / _KB:g}/{energy.sl_bit_per_j / _KB:g} kb/J"
    headings = ("robots in", "data center in", *(f"{name} (gCO2e)" for name in METHODS.values()), "least")
    return Table(
        f"Carbon by country at E_UL/E_SL = {at}, Table I's weights",
        (*headings, *(f"consensus FL beats {METHODS[other]}, E_SL (kb/J)" for _, other in PAIRS[:2])),
        shown,
        ("Yearly averages, life cycle: common/scenario/countries.py. In one country thresholds are those of joules.",),
    )


def make_study(results: Path, changes: Sequence[str], into: Path) -> list[Path]:
    """Write all tables and figures; returns the paths.

    Args:
        results: a results folder of `study baselines`.
        changes: `energy.key=value`, as in a scenario.
        into: a folder.

    Raises:
        ConfigurationError: a change that is none of prices, or that asks for more than sums.
        StudyError: `results` holds no study, or not these methods; or a file cannot be written.
    """
    scenario, _ = reprice(read_record(results).scenario, changes, str(results / RECORD))
    energy = scenario.energy
    if not energy.is_uniform:
        raise ConfigurationError(
            "--set: got constants of single robots or links, losses, motions or idle power; a study's facts are sums, "
            "expected constants that are the same for all"
        )
    found = cases(read_facts(results / FACTS), energy)
    made = Outputs(
        csv={
            "bills": bills_csv(found),
            "thresholds": thresholds_csv(found),
            "carbon": carbon_csv(found, energy),
        },
        markdown={"savazzi2021": [*thresholds_markdown(found), carbon_markdown(found, energy)]},
        figures={"winners": lambda: winners_figure(found), "carbon": lambda: carbon_figure(found["paper"], energy)},
    )
    return write_outputs(into, made)


def _along_sl(ul_bit_per_j: float) -> Callable[[Footprint], Curve]:
    return lambda footprint: footprint.along_sl(ul_bit_per_j)


def _cells(case: Case, one: str, other: str, along: Callable[[Footprint], Curve]) -> list[Cell]:
    """Where, at which kb/J, and the lowest and highest of single seeds that cross."""

    def verdict(mine: Footprint, theirs: Footprint) -> Verdict:
        return cheaper(along(mine), along(theirs))

    of_mean = verdict(*(totals(case)[method] for method in (one, other)))
    seeds = [verdict(a.weighted(), b.weighted()) for a, b in zip(case[one], case[other], strict=True)]
    held = [each.bit_per_j / _KB for each in seeds if each.bit_per_j is not None and each.where == of_mean.where]
    return [*_cell(of_mean), *((min(held), max(held)) if held else (None, None))]


def _cell(verdict: Verdict) -> tuple[str, float | None]:
    return verdict.where, None if verdict.bit_per_j is None else verdict.bit_per_j / _KB


def _told(cells: Sequence[Cell]) -> str:
    where, at, low, high = cells
    if not isinstance(at, float):
        return str(where)
    seeds = f" ({number(low)} to {number(high)})" if isinstance(low, float) and isinstance(high, float) else ""
    return f"{where} {number(at)}{seeds}"
