"""A table before it is shown on anything, and how it is shown: on a terminal, as Markdown, as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple

import rich.table
from rich.box import SIMPLE_HEAVY
from rich.console import Console
from rich.markup import escape

Cell = str | int | float | bool | None


class Table(NamedTuple):
    """One cell a heading in each row; the first column is a name, the others are figures.

    Floats are for programs: CSV has six digits of them, readers see three (see `number`). `styles` are of rows, by
    their numbers from 0: "bold" ends a section, "red" and "green" judge.
    """

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    notes: Sequence[str] = ()
    styles: Mapping[int, str] = MappingProxyType({})


_PADDING, _EDGES = 2, 2
"""Of a column, and of a table, on a terminal."""


def number(value: float) -> str:
    """A number for readers: three digits or one decimal, whichever is more."""
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.3g}"


def terminal(table: Table, *, wrap: bool = False, tight: bool = False) -> rich.table.Table:
    """For a console. `wrap`: names are sentences, which may be broken, and the figures may not; `tight`: columns are
    no wider than they must be, so that words and figures stay whole."""
    shown = rich.table.Table(
        title=escape(table.title),
        caption=escape("\n".join(table.notes)) or None,
        caption_justify="left",
        caption_style="dim",
        box=SIMPLE_HEAVY,
        padding=(0, 1, 0, 0),
        show_lines=wrap,
    )
    widths = _widths(table, whole=False) if tight else [None] * len(table.headings)
    for place, (heading, width) in enumerate(zip(table.headings, widths, strict=True)):
        side: Literal["left", "right"] = "right" if place else "left"
        shown.add_column(escape(heading), justify=side, no_wrap=(place == 0) != wrap and not tight, width=width)
    for row, style in styled(table):
        shown.add_row(*map(escape, row), style=style, end_section=style == "bold")
    return shown


def show(table: Table, console: Console) -> None:
    """Print it: whole, or where that is too wide in several, so that nothing is cut."""
    for part in narrowed(table, console.width):
        console.print(terminal(part, tight=_wide(_widths(part, whole=True)) > console.width))


def narrowed(table: Table, width: int) -> list[Table]:
    """The table; or where it is wider than so many characters several, each with some of its columns after names."""
    needs = _widths(table, whole=False)
    parts: list[list[int]] = [[]]
    for place in range(1, len(needs)):
        if parts[-1] and _wide([needs[each] for each in (0, *parts[-1], place)]) > width:
            parts.append([])
        parts[-1].append(place)
    return [
        table._replace(
            title=table.title if number == 0 else f"{table.title} (more of it)",
            headings=[table.headings[place] for place in (0, *part)],
            rows=[[row[place] for place in (0, *part)] for row in table.rows],
            notes=table.notes if number == len(parts) - 1 else (),
        )
        for number, part in enumerate(parts)
    ]


def _widths(table: Table, *, whole: bool) -> list[int]:
    """Characters that each column needs; headings are broken between words unless `whole`."""
    rows = [cells for cells, _ in styled(table)]
    return [
        max([*map(len, [heading] if whole else heading.split()), *(len(row[place]) for row in rows)], default=0)
        for place, heading in enumerate(table.headings)
    ]


def _wide(widths: Sequence[int]) -> int:
    return sum(widths) + _PADDING * len(widths) + _EDGES


def markdown_text(tables: Iterable[Table]) -> str:
    """Tables one below the other, each under a heading, its notes after it."""
    return "\n".join(_markdown(table) for table in tables)


def csv_text(table: Table) -> str:
    """For programs: numbers to six digits, so that another machine's rounding makes no other file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.headings)
    writer.writerows([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in table.rows)
    return text.getvalue()


def _markdown(table: Table) -> str:
    rule = ["---", *("---:" for _ in table.headings[1:])]
    lines = [_line(cells) for cells in (table.headings, rule, *(row for row, _ in styled(table)))]
    return "\n".join([f"### {table.title}", "", *lines, *(f"\n{note}" for note in table.notes)]) + "\n"


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def styled(table: Table) -> list[tuple[list[str], str]]:
    """Rows for readers, each with its style, for whatever shows them."""
    texts = ([_text(cell) for cell in row] for row in table.rows)
    return [(row, table.styles.get(place, "")) for place, row in enumerate(texts)]


def _text(cell: Cell) -> str:
    if cell is None:
        return "-"
    return number(cell) if isinstance(cell, float) else str(cell)
