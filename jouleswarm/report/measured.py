"""What the processes have measured of themselves, beside the bill and never in it."""

from __future__ import annotations

from jouleswarm.common.meter.joules import ACTIVITIES
from jouleswarm.report.format import TextTable, joules_text, number_text
from jouleswarm.runs.measured import by_activity
from jouleswarm.runs.run import Run

_ROLES = {"datacenter": "data center", "robot": "robots"}
_PHASES = {"": "start", "maml": "meta-learning", "fl": "clusters"}


def measured_tables(run: Run) -> list[TextTable]:
    """A table for each way that joules were had: a row for each arm's phase and role; none where nobody measured."""
    tables = []
    for how in dict.fromkeys(row.how for row in run.joules_rows):
        rows, held = [], [row for row in run.joules_rows if row.how == how]
        for arm, phase in dict.fromkeys((row.arm, row.phase) for row in held):
            for role, name in _ROLES.items():
                found = [row for row in held if (row.arm, row.phase, row.role) == (arm, phase, role)]
                if found:
                    waited = sum(row.seconds for row in found if row.activity == "idle")
                    spent = f"{number_text(sum(row.seconds for row in found))} ({number_text(waited)} idle)"
                    joules = map(joules_text, by_activity(found).values())
                    rows.append([f"{arm} {_PHASES[phase]}, {name}".strip(), *joules, spent])
        headings = ["arm", *ACTIVITIES, "all", "process seconds"]
        tables.append(TextTable(f"Measured joules ({how})", headings, rows))
    return tables
