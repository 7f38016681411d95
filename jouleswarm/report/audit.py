"""`jouleswarm audit`: the published numbers beside what each price list and Table II give."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rich.console import Console

from jouleswarm.report.audit_rows import EFFICIENT_SIDELINK, EFFICIENT_UPLINK, audit_rows, implied_bill, literal_bill
from jouleswarm.report.table import Table, show, terminal
from jouleswarm.runs.paper import TABLE_II

_LEGEND = (
    "literal: equations (8)-(12) with Table I's constants, E_DL = E_UL.",
    "published: what the printed totals come to, 352.4 J a MAML round and 246.3 J an FL round, defined at "
    "(E_UL, E_SL) = (200, 500) kb/J only; it agrees with E_ML at t0 = 210 and E without MAML by construction.",
)


def print_audit(console: Console | None = None) -> None:
    """Print how it ends, `audit_rows`, then Table II with its sums and what its rows cost."""
    console = console or Console()
    console.print(headline(), style="bold", highlight=False)
    console.print(terminal(_claims(), wrap=True))
    show(_table_ii(), console)


def headline() -> str:
    """How many of the published figures follow from the paper's own equations and tables, in one line."""
    rows = audit_rows()
    good = sum(row.consistent for row in rows)
    return (
        f"{good} of {len(rows)} published figures follow from the paper's own equations and tables, "
        f"{len(rows) - good} do not."
    )


def audit_document() -> dict[str, Any]:
    """The same as plain data."""
    rows = audit_rows()
    told = [
        {
            **asdict(row),
            "follows": row.consistent,
            "agrees": {name: row.agrees(each) for name, each in row.given.items()},
        }
        for row in rows
    ]
    follow = sum(row.consistent for row in rows)
    return {"figures": len(rows), "follow": follow, "do_not_follow": len(rows) - follow, "rows": told}


def _claims() -> Table:
    rows, styles = [], {}
    for place, row in enumerate(audit_rows()):
        note = f" ({row.note})" if row.note else ""
        values = (_number(value) for value in (row.table_ii, row.literal, row.published))
        printed = f"{'≥ ' if row.at_least else ''}{row.printed}"
        rows.append([f"{row.quantity} {row.place}\n{row.verdict}{note}", printed, *values, row.unit])
        styles[place] = "green" if row.consistent else "red"
    headings = ["quantity, and whether it agrees", "printed", "Table II", "literal", "published", "unit"]
    title = "Published numbers against the paper's own equations and tables"
    return Table(title, headings, rows, _LEGEND, styles)


def _table_ii() -> Table:
    rows = []
    for t0, rounds in TABLE_II.items():
        literal_j = [literal_bill(t0, energy).total_j for energy in (EFFICIENT_SIDELINK, EFFICIENT_UPLINK)]
        totals = [joules / 1e3 for joules in (implied_bill(t0).total_j, *literal_j)]
        rows.append([str(t0), *(f"{value:.1f}" for value in (*rounds, sum(rounds), *totals))])
    tasks = [f"t_{task}" for task in range(1, 7)]
    headings = ["t0", *tasks, "sum", "published\n200,500", "literal\n200,500", "literal\n500,200"]
    return Table("Table II, summed, and priced in kJ at (E_UL, E_SL) in kb/J", headings, rows)


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.0f}" if value >= 1000 or value == 0 else f"{value:.3f}" if value < 1 else f"{value:.4g}"
