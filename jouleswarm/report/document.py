"""`jouleswarm report --json`: a run's bill as plain data."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.scenario.reading import Override
from jouleswarm.energy.repricing import reprice
from jouleswarm.metering.metered import Metered
from jouleswarm.report.budget import budget_table
from jouleswarm.report.calculated import calculated, document
from jouleswarm.report.metered import metered_tables
from jouleswarm.report.notes import warnings
from jouleswarm.report.opened import load
from jouleswarm.report.outside import Meters, outside_table
from jouleswarm.report.table import Table
from jouleswarm.report.why import why_tables
from jouleswarm.runs.curves import curves
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
    run = load(run_directory)
    if isinstance(run, Metered):
        if budget is not None or why or meters is not None:
            raise ConfigurationError(f"{run_directory}: of what a meter counted: no --budget, --why or --meter")
        return _metered_document(run, changes)
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


def _metered_document(metered: Metered, changes: Iterable[Override]) -> dict[str, Any]:
    tariff, _ = metered.priced(changes)
    return {
        "run": str(metered.path),
        "status": metered.status,
        "bill": document(calculated(metered.bill_rows, tariff)) if metered.bill_rows else None,
        "tables": [table_document(table) for table in metered_tables(metered, tariff)],
    }


def table_document(table: Table) -> dict[str, Any]:
    """A table as plain data."""
    rows = [dict(zip(table.headings, row, strict=True)) for row in table.rows]
    return {"title": table.title, "rows": rows, "notes": list(table.notes)}
