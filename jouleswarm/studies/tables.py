"""Tables as text: CSV for programs, Markdown for readers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from jouleswarm.studies.estimates import Estimate

Cell = str | int | float | bool | None
_NOTHING = "-"


class Spread(NamedTuple):
    """Cells of an estimate in a CSV row, and their column names from `of`."""

    mean: float | None
    ci95: float | None


class Table(NamedTuple):
    """A table under a title; `rows` hold one cell a heading."""

    title: str
    headings: tuple[str, ...]
    rows: list[tuple[Cell, ...]]
    notes: tuple[str, ...] = ()


def csv_text(table: Table) -> str:
    """The table as CSV: numbers to six digits, so that another machine's rounding makes no other file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.headings)
    writer.writerows([_csv_cell(cell) for cell in row] for row in table.rows)
    return text.getvalue()


def markdown_text(tables: Iterable[Table]) -> str:
    """Tables one below the other, each under a heading, its notes after it."""
    return "\n".join(_markdown(table) for table in tables)


def spread(found: Estimate | None) -> Spread:
    """An estimate as two CSV cells, both empty where there is none."""
    return Spread(None, None) if found is None else Spread(found.mean, found.ci95)


def estimate_text(found: Estimate | None, factor: float = 1.0) -> str:
    """`12.3 ± 4.5` in units of `factor`; without the interval of one seed; "-" for None."""
    if found is None:
        return _NOTHING
    mean = number(found.mean / factor)
    return mean if found.ci95 is None else f"{mean} ± {number(found.ci95 / factor)}"


def number(value: float | None) -> str:
    """A number for readers: three digits or one decimal, whichever is more; "-" for None."""
    if value is None:
        return _NOTHING
    if abs(value) >= 10:
        return f"{value:.1f}"
    return f"{value:.3g}"


def failures_text(failures: int, trials: int) -> str:
    """How many of the tasks' trials were not learned."""
    return f"{failures} of {trials}"


def _csv_cell(cell: Cell) -> str:
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell:.6g}"
    return str(cell)


def _markdown(table: Table) -> str:
    lines: list[str] = [f"### {table.title}", "", _line(table.headings)]
    lines.append(_line(["---", *("---:" for _ in table.headings[1:])]))
    lines += [_line([number(cell) if isinstance(cell, float) else _text(cell) for cell in row]) for row in table.rows]
    for note in table.notes:
        lines += ["", note]
    return "\n".join(lines) + "\n"


def _text(cell: Cell) -> str:
    return _NOTHING if cell is None else str(cell)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
