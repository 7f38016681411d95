"""What was measured beside the counts of a table, by activity: told, never priced. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.energy.rows import MEASURED, Row


class Measured(NamedTuple):
    """What the processes of one site took for one activity of an arm, rounds together."""

    arm: str
    site: str
    """Of `energy.bill.SITES`."""
    activity: str
    seconds: float
    cpu_s: float
    joules: Mapping[str, float]
    """How they were had -> joules."""


def measured(rows: Iterable[Row]) -> list[Measured]:
    """Sums in the order of the rows."""
    sums: dict[tuple[str, str, str], dict[tuple[str, str], float]] = {}
    for row in rows:
        if row.what in MEASURED:
            place = (row.arm, "datacenter" if row.robot == DATA_CENTER else "robots", row.activity)
            held = sums.setdefault(place, {})
            held[row.what, row.how] = held.get((row.what, row.how), 0) + row.value
    found = []
    for place, held in sums.items():
        seconds, cpu_s = (sum(value for (each, _), value in held.items() if each == what) for what in MEASURED[:2])
        joules = {how: value for (what, how), value in held.items() if what == "joules"}
        found.append(Measured(*place, seconds, cpu_s, joules))
    return found
