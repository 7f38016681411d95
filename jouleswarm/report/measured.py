"""What the processes have measured of themselves, beside the bill and never in it."""

from __future__ import annotations

from jouleswarm.common.meter.joules import ACTIVITIES
from jouleswarm.report.format import number_text
from jouleswarm.report.table import Table
from jouleswarm.runs.measured import by_activity
from jouleswarm.runs.run import Run

_ROLES = {"datacenter": "center", "robot": "robots"}
_PHASES = {"": "start", "maml": "meta", "fl": "clusters"}
_SHORT = {"communication": "comm."}


def measured_tables(run: Run) -> list[Table]:
    """A table for each way that joules were had: a row for each arm's phase and role; none where nobody measured."""
    tables = []
    for how in dict.fromkeys(row.how for row in run.joules_rows):
        rows, held = [], [row for row in run.joules_rows if row.how == how]
        for phase, arm, role in sorted({(row.phase, row.arm, row.role) for row in held}, key=_order):
            found = [row for row in held if (row.phase, row.arm, row.role) == (phase, arm, role)]
            joules = [number_text(each) for each in by_activity(found).values()]
            waited = sum(row.seconds for row in found if row.activity == "idle")
            spent = [number_text(sum(row.seconds for row in found)), number_text(waited)]
            rows.append([f"{arm} {_PHASES[phase]}, {_ROLES[role]}".strip(), *joules, *spent])
        activities = [_SHORT.get(each, each) for each in ACTIVITIES]
        tables.append(Table(f"Measured joules ({how})", ["", *activities, "all", "seconds", "idle s"], rows))
    return tables


def _order(place: tuple[str, str, str]) -> tuple[int, str, str]:
    phase, arm, role = place
    return list(_PHASES).index(phase), arm, role
