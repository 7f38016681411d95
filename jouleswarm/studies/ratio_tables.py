"""Tables of what transfer gains."""

from __future__ import annotations

from collections.abc import Sequence

from jouleswarm.report.table import Cell, Table, number
from jouleswarm.studies.arms import Groups
from jouleswarm.studies.ratios import FIRST, FULL, JOULES, Row, Told
from jouleswarm.studies.significance import Between
from jouleswarm.studies.tables import at_least, between_text, failures_text

TEST_NOTE = (
    "Ratios are without over with transfer, with the middle 95% over seeds drawn again; p is of Wilcoxon's signed-rank "
    "test over seeds, exact, two-sided, by Holm over all methods and t0 of the table."
)
_ROUNDS_NOTE = (
    "t_i by the full window of R, the paper's measure; first success is the first round in which the cluster's mean "
    "reward reached the target. Copied: R at the target in round 0 or 1. RMSE at the stop, mean and worst."
)
_BOUNDS_NOTE = (
    "A run that was cut off at max_rounds counts with the rounds it ran: ≥ is a lower bound, a ratio of which is ≤ "
    "where runs with transfer were cut off, ≥ where those without were, ≈ where both."
)
CHEAPEST_NOTE = (
    "Without is fl, the paper's baseline, which need not be the cheapest: `study baselines` has one robot a task and "
    "robots that exchange nothing (isolated) beside it."
)


def ratios_csv(rows: Sequence[Row]) -> Table:
    """A row a measure, group of tasks, method and t0."""
    cells: list[tuple[Cell, ...]] = []
    for row in rows:
        spans: list[Cell] = [cell for between in row.gain for cell in between]
        means = (row.seeds, row.without, row.with_)
        cells.append(
            (row.method, row.t0, row.tasks, row.measure, *means, *spans, row.p, row.p_holm, *row.mine, *row.plain)
        )
    gains = [name for of in ("ratio_of_means", "mean_of_ratios") for name in (of, f"{of}_low95", f"{of}_high95")]
    head = ("method", "t0", "tasks", "measure", "seeds", "without", "with", *gains, "p", "p_holm")
    return Table("Gain of transfer", (*head, *Told._fields, *(f"plain_{name}" for name in Told._fields)), cells)


def ratios_markdown(rows: Sequence[Row], groups: Groups) -> list[Table]:
    """For readers, a table a group of tasks: rounds, then bills; the unseen ones first."""
    return [
        table
        for name, tasks in groups.items()
        for table in (_rounds_table(rows, name, tasks), _bills_table(rows, name, tasks))
    ]


def _rounds_table(rows: Sequence[Row], name: str, tasks: Sequence[int]) -> Table:
    first = {(row.method, row.t0): row for row in rows if (row.tasks, row.measure) == (name, FIRST)}
    cells: list[tuple[Cell, ...]] = []
    for row in (row for row in rows if (row.tasks, row.measure) == (name, FULL)):
        other = first[row.method, row.t0]
        counted = [
            at_least(number(value), told.not_learned)
            for each in (row, other)
            for value, told in ((each.without, row.plain), (each.with_, row.mine))
        ]
        gains = [bounded_text(row, between) for between in (*row.gain, other.gain.of_means)]
        cells.append(
            (row.method, row.t0, *counted[:2], *gains[:2], p_text(row), *counted[2:], gains[2], _share(row.mine.copied),
             failures_text(row.mine.not_learned, row.mine.trials), *_rmse(row.mine), *_rmse(row.plain))
        )  # fmt: skip
    headings = ("method", "t0", "t_i without", "with", "ratio of means", "mean of ratios", "p (Holm)", "first success")
    more = ("with", "ratio", "copied", "not learned", "RMSE (m)", "worst", "RMSE without (m)", "worst")
    return Table(f"Rounds, {_title(name, tasks)}", (*headings, *more), cells, (TEST_NOTE, _ROUNDS_NOTE, _BOUNDS_NOTE))


def _bills_table(rows: Sequence[Row], name: str, tasks: Sequence[int]) -> Table:
    cells: list[tuple[Cell, ...]] = []
    for row in (row for row in rows if row.tasks == name and row.measure.startswith(JOULES)):
        without, with_ = (
            at_least(number(joules / 1e3), told.not_learned)
            for joules, told in ((row.without, row.plain), (row.with_, row.mine))
        )
        gains = [bounded_text(row, between) for between in row.gain]
        head = (row.method, row.t0, row.measure.removeprefix(JOULES))
        cells.append((*head, without, with_, *gains, between_text(inverse(row.gain.of_means)), p_text(row)))
    headings = ("method", "t0", "prices", "E without (kJ)", "E with", "ratio of means", "mean of ratios")
    told = "The bill is that of the whole stage, of its way down to these tasks' robots, and of their own learning."
    notes = (told, TEST_NOTE, CHEAPEST_NOTE)
    return Table(f"Bills, {_title(name, tasks)}", (*headings, "E with / E without", "p (Holm)"), cells, notes)


def bounded_text(row: Row, gain: Between) -> str:
    """A ratio with what being cut off makes of it."""
    bound = {(False, False): "", (True, False): "≥ ", (False, True): "≤ ", (True, True): "≈ "}
    return bound[row.plain.not_learned > 0, row.mine.not_learned > 0] + between_text(gain)


def inverse(of: Between) -> Between:
    """With over without, of without over with."""
    value, low, high = (None if each is None else 1 / each if each else float("inf") for each in of)
    return Between(value or 0.0, high, low)


def p_text(row: Row) -> str:
    """Readers need no more digits of p than these."""
    return "-" if row.p_holm is None else f"{row.p_holm:.2g}"


def _title(name: str, tasks: Sequence[int]) -> str:
    told = ", ".join(map(str, tasks))
    return f"all tasks ({told})" if name == "all" else f"{name} tasks ({told})"


def _share(share: float | None) -> str:
    return "-" if share is None else f"{share:.0%}"


def _rmse(told: Told) -> tuple[Cell, Cell]:
    return told.rmse_mean_m, told.rmse_worst_m
