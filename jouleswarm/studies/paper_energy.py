"""Energy by t0, the optimal t0, and how many tasks it takes until meta-learning pays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.breakeven import returns_to_pay, tasks_to_pay
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList
from jouleswarm.energy.published import published
from jouleswarm.report.table import Cell, Table
from jouleswarm.runs.paper import PrintedTotal, printed_total
from jouleswarm.studies.arms import PLAIN, failures_of, lines_of, series_of
from jouleswarm.studies.breakeven import Compared, at_papers_sizes, compared
from jouleswarm.studies.columns import MOTIONS, Column, carbon_columns, site_columns
from jouleswarm.studies.estimates import Estimate, estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import PAIRS, PRICE_LISTS, Efficiencies, failures, priced, runs_of, task_stages
from jouleswarm.studies.tables import at_least, estimate_text, failures_text, spread

_UNDEFINED = "The paper implies no prices for these methods at these efficiencies."
_UNKNOWN = "This price list has no bill for these facts: it is not defined, or asks for more than a study keeps."


class EnergyRow(NamedTuple):
    """Joules of one t0 over seeds."""

    t0: int
    ml: Estimate
    fl: Estimate
    total: Estimate
    method: str = PLAIN
    arm: str = PLAIN
    not_learned: int = 0


def energy_rows(facts: Sequence[Fact], energy: Energy, pair: Efficiencies, prices: PriceList) -> list[EnergyRow] | None:
    """E_ML, the sum of E_FL and E of every line of `lines_of`; None where the price list is not defined."""
    rows = []
    for method, t0, arm in lines_of(facts):
        found = [priced(run, pair.of(energy), prices) for run in runs_of(facts, "", arm).values()]
        held = [joules for joules in found if joules is not None]
        if len(held) < len(found):
            return None
        parts = ([j.ml.total_j for j in held], [j.fl.total_j for j in held], [j.total_j for j in held])
        ml, fl, total = map(estimate, parts)
        rows.append(EnergyRow(t0, ml, fl, total, method, arm, failures_of(facts, "", arm)[0]))
    return rows


def optimum(rows: Sequence[EnergyRow], *, with_meta: bool = False) -> EnergyRow:
    """The row of the lowest mean total energy; of those with meta-learning only, if asked and there are any."""
    held = [row for row in rows if row.t0 > 0] if with_meta else []
    return min(held or rows, key=lambda row: row.total.mean)


def energy_csv(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> Table:
    """A row a pair of efficiencies, price list, method and t0; no joules where the price list is not defined."""
    rows: list[tuple[Cell, ...]] = []
    for pair in PAIRS:
        for prices in lists:
            held = {row.arm: row for row in energy_rows(facts, energy, pair, prices) or ()}
            for method, t0, arm in lines_of(facts):
                row = held.get(arm)
                parts = (row.ml, row.fl, row.total) if row else (None, None, None)
                cells = [cell for part in parts for cell in spread(part)]
                counted = (len(runs_of(facts, "", arm)), *failures_of(facts, "", arm))
                printed = _printed(method, t0, pair)
                told = (printed.ml_j, printed.total_j) if printed else (None, None)
                more = [
                    cell
                    for each in _more_columns(pair.of(energy), prices)
                    for cell in spread(each.over(facts, "", arm))
                ]
                rows.append((*_head(pair, prices, method, t0), *cells, *counted, *told, *more))
    return Table(
        "Energy by t0",
        (
            *("ul_kb_per_j", "sl_kb_per_j", "prices", "method", "t0", "ml_j", "ml_ci95", "fl_j", "fl_ci95"),
            *("total_j", "total_ci95", "seeds", "not_learned", "trials", "printed_ml_j", "printed_total_j"),
            *(name for column in _more_columns(energy, literal) for name in column.names),
        ),
        rows,
    )


def optimum_csv(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> Table:
    """The t0 of least energy of each pair, price list and method, of all and of those with meta-learning."""
    rows: list[tuple[Cell, ...]] = []
    for pair in PAIRS:
        for prices in lists:
            for method, mine in series_of(facts).items():
                held = energy_rows(mine, energy, pair, prices)
                if held is None:
                    continue
                best, best_meta = optimum(held), optimum(held, with_meta=True)
                meta_cells = (best_meta.t0, best_meta.total.mean) if best_meta.t0 else (None, None)
                printed = next((t0 for t0 in (42, 132) if _printed(method, t0, pair)), None)
                head = _head(pair, prices, method, best.t0)
                counted = (failures(mine), len(task_stages(mine)))
                rows.append((*head, best.total.mean, *meta_cells, printed, *counted))
    headings = ("ul_kb_per_j", "sl_kb_per_j", "prices", "method", "t0", "total_j", "t0_with_meta", "total_with_meta_j")
    return Table("Optimal t0", (*headings, "printed_t0", "not_learned", "trials"), rows)


def energy_markdown(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> list[Table]:
    """The same for readers, in kJ, the optimum marked."""
    tables = []
    for pair in PAIRS:
        for prices in lists:
            told = ": Table I's powers and times, bytes as counted" if prices is literal else ""
            title = f"Energy (kJ), E_UL/E_SL = {pair.label}, {prices.label}{told}"
            held = energy_rows(facts, energy, pair, prices)
            headings = (
                "method",
                "t0",
                "E_ML",
                "sum of E_FL",
                "E",
                "not learned",
                "printed E",
                *(column.heading for column in _more_columns(energy, literal)),
            )
            if held is None:
                note = _UNDEFINED if prices is published else _UNKNOWN
                tables.append(Table(title, headings, [], (note,)))
                continue
            best = optimum(held)
            rows = []
            for row in held:
                columns = _more_columns(pair.of(energy), prices)
                more = (
                    at_least(estimate_text(each.over(facts, "", row.arm), each.unit), row.not_learned)
                    for each in columns
                )
                rows.append((*_row(facts, pair, row, row is best), *more))
            tables.append(Table(title, headings, rows, ("The lowest mean is bold; ≥: runs were cut off.",)))
    return tables


def break_even_csv(
    facts: Sequence[Fact], energy: Energy, training: Sequence[int], lists: Sequence[PriceList] = PRICE_LISTS
) -> Table:
    """M*, the number of tasks beyond which meta-learning pays, and how often seen tasks must return; inf: never.

    Over what was counted, and by the paper's batches and bytes throughout (`sizes`), for whose network Table I's times
    are. The intervals are the middle 95% over seeds drawn again.
    """
    rows: list[tuple[Cell, ...]] = []
    for pair in PAIRS:
        for prices in lists:
            for sizes, view in (("counted", facts), ("paper", at_papers_sizes(facts, len(training)))):
                for each in compared_arms(view, training):
                    cells = _break_even(each, pair.of(energy), prices)
                    counted = (failures_of(facts, "", arm) for arm in (each.arm, PLAIN))
                    head = _head(pair, prices, each.method, each.t0)
                    rows.append((*head, sizes, *cells, *(cell for pair_ in counted for cell in pair_)))
    headings = ("ul_kb_per_j", "sl_kb_per_j", "prices", "method", "t0", "sizes")
    saved = ("stage_j", "seen_saved_j", "unseen_saved_j")
    answers = ("plain_task_j", "break_even_tasks", "low95", "high95", "returns", "returns_low95", "returns_high95")
    failed = ("not_learned", "trials", "plain_not_learned", "plain_trials")
    return Table("Break-even", (*headings, *saved, *answers, *failed), rows)


def compared_arms(facts: Sequence[Fact], training: Sequence[int]) -> list[Compared]:
    """Every arm with a stage, with the one without beside it; none where that was not run."""
    lines = lines_of(facts)
    ran = any(line.arm == PLAIN for line in lines)
    return [compared(facts, line.arm, PLAIN, training) for line in lines if line.t0] if ran else []


def _break_even(each: Compared, energy: Energy, prices: PriceList) -> tuple[Cell, ...]:
    found = each.means(energy, prices)
    if found is None:
        return (None,) * 10
    answers: list[Cell] = []
    for of in (tasks_to_pay, returns_to_pay):
        answers += [of(found), *(each.between(of, energy, prices) or (None, None))]
    return found.stage_j, found.seen_j, found.unseen_j, found.plain_j, *answers


def _more_columns(energy: Energy, prices: PriceList) -> list[Column]:
    return [*site_columns(energy, prices), MOTIONS, *carbon_columns(energy, prices)]


def _row(facts: Sequence[Fact], pair: Efficiencies, row: EnergyRow, best: bool) -> tuple[Cell, ...]:
    ml, *others = (estimate_text(part, 1e3) for part in (row.ml, row.fl, row.total))
    fl, total = (at_least(each, row.not_learned) for each in others)
    printed = _printed(row.method, row.t0, pair)
    told = f"{printed.total_j / 1e3:g}" if printed else None
    not_learned = failures_text(*failures_of(facts, "", row.arm))
    return row.method, row.t0, ml, fl, f"**{total}**" if best else total, not_learned, told


def _printed(method: str, t0: int, pair: Efficiencies) -> PrintedTotal | None:
    """The paper's is MAML's, and stands beside whatever method was learned to the same t0."""
    found = printed_total("maml" if t0 else method, t0, *pair)
    return found if found is not None and found.t0 == t0 else None


def _head(pair: Efficiencies, prices: PriceList, method: str, t0: int) -> tuple[Cell, ...]:
    return pair.ul_bit_per_j / 1e3, pair.sl_bit_per_j / 1e3, prices.name, method, t0
