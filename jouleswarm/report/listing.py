"""`jouleswarm runs`: the runs of a folder as a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from datetime import datetime
from typing import Any

from jouleswarm.report.format import joules_text
from jouleswarm.report.table import Table
from jouleswarm.runs.listing import ListedRun

_HEADINGS = ("run", "status", "scenario", "seed", "age", "arms", "rounds", "joules")
_AGES = (("d", 86400), ("h", 3600), ("min", 60))


def runs_table(runs: Sequence[ListedRun], now: datetime) -> Table:
    """A row a run."""
    rows = [
        [
            *(run.path.name, run.status, run.scenario or None, run.seed, age_text(run, now)),
            *(_joined(arm.name for arm in run.arms), _joined(str(arm.rounds) for arm in run.arms)),
            _joined(joules_text(arm.joules) for arm in run.arms),
        ]
        for run in runs
    ]
    return Table("Runs, newest first", _HEADINGS, rows)


def runs_document(runs: Iterable[ListedRun]) -> list[dict[str, Any]]:
    """The same as plain data."""
    return [asdict(run) | {"path": str(run.path), "started": run.started and run.started.isoformat()} for run in runs]


def age_text(run: ListedRun, now: datetime) -> str | None:
    """How long ago it began."""
    if run.started is None:
        return None
    age_s = max(0.0, (now - run.started).total_seconds())
    return next((f"{age_s / size:.0f} {unit}" for unit, size in _AGES if age_s >= size), f"{age_s:.0f} s")


def _joined(texts: Iterable[str]) -> str | None:
    return ", ".join(texts) or None
