"""How a report writes numbers, and a table before it is shown on anything."""

from __future__ import annotations

from dataclasses import dataclass

from rich.box import SIMPLE_HEAVY
from rich.table import Table

_NOTHING = "-"


@dataclass(frozen=True)
class TextTable:
    """A table as text; the first column is left-aligned, `strong` are the numbers of rows that stand out."""

    title: str
    headings: list[str]
    rows: list[list[str]]
    strong: frozenset[int] = frozenset()


def joules_text(joules: float | None) -> str:
    """Joules to four digits, "-" where not defined or not known; a small run stands beside the paper's large one."""
    if joules is None:
        return _NOTHING
    for unit, factor in (("MJ", 1e6), ("kJ", 1e3)):
        if joules >= factor:
            return f"{joules / factor:.4g} {unit}"
    return f"{joules:.4g} J"


def grams_text(grams: float | None) -> str:
    """Grams of CO2 equivalent to four digits; what is not known is said to be so, it is not nothing."""
    if grams is None:
        return "unknown"
    return f"{grams / 1e3:.4g} kg" if grams >= 1e3 else f"{grams:.4g} g"


def number_text(value: float | None, decimals: int = 1) -> str:
    """A number, "-" for None."""
    return _NOTHING if value is None else f"{value:.{decimals}f}"


def bytes_text(size_bytes: float) -> str:
    """Bytes in a unit that keeps four digits."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= factor:
            return f"{size_bytes / factor:.4g} {unit}"
    return f"{size_bytes:.0f} B"


def rich_table(text: TextTable) -> Table:
    """As a terminal shows it."""
    table = Table(title=text.title, box=SIMPLE_HEAVY, padding=(0, 1, 0, 0))
    for place, heading in enumerate(text.headings):
        table.add_column(heading, justify="right" if place else "left", no_wrap=not place)
    for number, row in enumerate(text.rows):
        strong = number in text.strong
        table.add_row(*row, style="bold" if strong else "", end_section=strong)
    return table
