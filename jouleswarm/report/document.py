"""`jouleswarm report --json`: a run's bill as plain data."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jouleswarm.common.errors import RunError
from jouleswarm.common.scenario.reading import Override
from jouleswarm.energy.repricing import reprice
from jouleswarm.report.budget import budget_table
from jouleswarm.report.notes import warnings
from jouleswarm.report.outside import Meters, outside_table
from jouleswarm.report.table import Table
from jouleswarm.report.why import why_tables
from jouleswarm.runs.curves import curves
from jouleswarm.runs.run import load_run
from jouleswarm.runs.summary import summarise


def report_document(
    run_directory: Path,
    changes: Iterable[Override] = (),
    *,
    budget: str | None = None,
    why: bool = False,
    meters: Meters | None = None,
) -> dict[str, Any]:
    """What a run's `summary.json` would hold at these prices, the constants that are not the paper's, and the tables
    that were asked for.

    Raises:
        ConfigurationError: no run directory, or a price that is none.
        RunError: it is damaged, or its counters contradict each other.
    """
    run = load_run(run_directory)
    priced, _ = reprice(run.scenario, changes, str(run_directory))
    run = run.at(priced)
    if run.misfits:
        raise RunError(f"{run.path}: {warnings(run)[0]}")
    tables = why_tables(run, priced.energy) if why else []
    if budget is not None:
        tables.append(budget_table(curves(run, priced.energy), budget))
    if meters is not None:
        tables.append(outside_table(run, priced.energy, meters))
    summary = summarise(
        run.scenario,
        run.rows,
        run.meter_rows,
        work_rows=run.work_rows,
        joules_rows=run.joules_rows,
        source=str((run.summary or {}).get("counters", "")),
    )
    return {
        "run": str(run.path),
        "scenario": run.scenario.name,
        "energy": priced.energy.model_dump(mode="json", exclude_defaults=True),
        "summary": {**summary, "status": run.status},
        "tables": [table_document(table) for table in tables],
    }


def table_document(table: Table) -> dict[str, Any]:
    """A table as plain data."""
    rows = [dict(zip(table.headings, row, strict=True)) for row in table.rows]
    return {"title": table.title, "rows": rows, "notes": list(table.notes)}
