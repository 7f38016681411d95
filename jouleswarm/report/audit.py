"""`jouleswarm audit`: the published numbers beside what each price list and Table II give."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.table import Table

from jouleswarm.report.audit_rows import (
    EFFICIENT_SIDELINK,
    EFFICIENT_UPLINK,
    AuditRow,
    audit_rows,
    implied_bill,
    literal_bill,
)
from jouleswarm.runs.paper import TABLE_II

__all__ = ["AuditRow", "audit_rows", "print_audit"]

_LEGEND = (
    "[bold]literal[/bold]: equations (8)-(12) with Table I's constants, E_DL = E_UL. "
    "[bold]published[/bold]: what the printed totals come to, 352.4 J a MAML round and 246.3 J an FL round, defined at "
    "(E_UL, E_SL) = (200, 500) kb/J only; it agrees with E_ML at t0 = 210 and E without MAML by construction."
)


def print_audit(console: Console | None = None) -> None:
    """Print `audit_rows`, then Table II with its sums and what its rows cost."""
    console = console or Console()
    console.print(_claims())
    console.print(_table_ii())
    console.print(_LEGEND)


def _claims() -> Table:
    title = "Published numbers against the paper's own equations and tables"
    table = Table(title=title, box=box.SIMPLE, show_lines=True, pad_edge=False)
    table.add_column("quantity, and whether it agrees")
    for heading in ("printed", "Table II", "literal", "published"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for row in audit_rows():
        sign = "≥ " if row.relation == "at least" else ""
        values = [_number(value) for value in (row.table_ii, row.literal, row.published)]
        colour = "green" if row.consistent else "red"
        note = f" [dim]({row.note})[/dim]" if row.note else ""
        quantity = f"{row.quantity} [dim]{row.place}[/dim]\n[{colour}]{row.verdict}[/{colour}]{note}"
        table.add_row(quantity, sign + row.printed, *values, row.unit)
    return table


def _table_ii() -> Table:
    table = Table(
        title="Table II, summed, and priced in kJ at (E_UL, E_SL) in kb/J",
        box=box.SIMPLE,
        pad_edge=False,
        padding=(0, 0, 0, 1),
    )
    tasks = [f"t_{task}" for task in range(1, 7)]
    prices = ("published\n200,500", "literal\n200,500", "literal\n500,200")
    for heading in ("t0", *tasks, "sum", *prices):
        table.add_column(heading, justify="right", no_wrap=True)
    for t0, rounds in TABLE_II.items():
        totals_j = (
            implied_bill(t0).total_j,
            literal_bill(t0, EFFICIENT_SIDELINK).total_j,
            literal_bill(t0, EFFICIENT_UPLINK).total_j,
        )
        found = (*rounds, sum(rounds), *(total_j / 1e3 for total_j in totals_j))
        table.add_row(str(t0), *(f"{value:.1f}" for value in found))
    return table


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.0f}" if value >= 1000 or value == 0 else f"{value:.3f}" if value < 1 else f"{value:.4g}"
