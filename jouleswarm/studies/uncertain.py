"""Bills of a study where constants are ranges: Monte Carlo over prices and over seeds."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from statistics import fmean
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, own_lists, price
from jouleswarm.energy.uncertain import Interval, draw, interval, pays
from jouleswarm.report.table import Cell, Table, number
from jouleswarm.studies.arms import PLAIN
from jouleswarm.studies.comparison import arms_of
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import facts_of, runs_of

_DRAWS = 500


class Row(NamedTuple):
    """The bill of an arm, a mean over seeds."""

    variant: str
    arm: str
    prices: str
    nominal_j: float
    """At the nominal constants, of the seeds as they are."""
    by_prices: Interval
    """Over draws of the constants."""
    by_both: Interval
    """Over draws of the constants, with seeds drawn again as often (Efron 1979)."""
    pays: float | None
    """Share of these draws in which the arm is cheaper than learning without transfer on the same seeds."""


def uncertain_rows(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList]) -> list[Row]:
    """A row a variant, arm and price list that depends on constants; none where all constants are exact."""
    rows: list[Row] = []
    if not energy.uncertain:
        return rows
    drawn = list(draw(energy, _DRAWS))
    arms = sorted(arms_of(facts), key=lambda each: each[1] != PLAIN)  # the one that others are compared with first
    for prices in (literal, *own_lists(lists)):
        plain: dict[str, tuple[list[int], NDArray[np.float64]]] = {}  # [draws, seeds] of the arm without transfer
        for variant, arm in arms:
            held = {seed: facts_of(run) for seed, run in runs_of(facts, variant, arm).items()}
            seeds, now = list(held), _joules(held.values(), [energy], prices)
            if np.isnan(now).any():
                continue
            table = _joules(held.values(), drawn, prices)
            joules = _again(table)
            if arm == PLAIN:
                plain[variant] = seeds, table
            others = None if arm == PLAIN else _of_seeds(seeds, *plain.get(variant, ([], table)))
            rows.append(
                Row(
                    variant, arm, prices.name, fmean(now[0]), interval(np.array([fmean(row) for row in table])),
                    interval(joules), None if others is None else pays(joules, _again(others)),
                )
            )  # fmt: skip
    order = arms_of(facts)
    return sorted(rows, key=lambda row: order.index((row.variant, row.arm)))


def _of_seeds(wanted: list[int], seeds: list[int], table: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Columns of [draws, seeds] for some of the seeds; None where one is not there."""
    places = [seeds.index(seed) for seed in wanted if seed in seeds]
    return np.asarray(table[:, places]) if len(places) == len(wanted) else None


def _joules(facts: Collection[Facts], drawn: Sequence[Energy], prices: PriceList) -> NDArray[np.float64]:
    """[draws, seeds] totals; NaN where the list has no bill."""
    bills = [[price(prices, each, energy) for each in facts] for energy in drawn]
    return np.array([[np.nan if bill is None else bill.total_j for bill in row] for row in bills])


def _again(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """[draws] means over seeds drawn with replacement, the same ones for all arms."""
    draws, seeds = table.shape
    places = np.random.default_rng(1).integers(seeds, size=(draws, seeds))
    return np.asarray(np.take_along_axis(table, places, axis=1).mean(axis=1))


def uncertain_csv(rows: Sequence[Row]) -> Table:
    """For programs."""
    cells: list[tuple[Cell, ...]] = [(*row[:4], *row.by_prices, *row.by_both, row.pays) for row in rows]
    told = [f"{of}_{name}" for of in ("prices", "both") for name in ("mean_j", "low95_j", "high95_j")]
    return Table("Uncertain constants", ("variant", "arm", "prices", "total_j", *told, "pays"), cells)


def uncertain_markdown(rows: Sequence[Row], energy: Energy) -> Table:
    """The same for readers, in kJ."""

    def span(of: Interval) -> str:
        return f"{number(of.low / 1e3)} to {number(of.high / 1e3)}"

    cells = [
        (f"{row.variant} {row.arm}".strip(), row.prices, row.nominal_j / 1e3, row.by_both.mean / 1e3,
         span(row.by_prices), span(row.by_both), None if row.pays is None else f"{row.pays:.1%}")
        for row in rows
    ]  # fmt: skip
    ranges = ", ".join(f"{name} {each.low:g} to {each.high:g}" for name, each in energy.uncertain.items())
    headings = ("arm", "prices", "E, nominal", "mean", "95%, prices", "95%, prices and seeds", "cheaper than without")
    return Table(f"E (kJ) where constants are ranges: {ranges}", headings, cells)
