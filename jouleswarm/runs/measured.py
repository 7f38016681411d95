"""Measured joules summed: never with joules that have been had in another way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from jouleswarm.common.meter.joules import ACTIVITIES, JoulesRow


def by_activity(rows: Iterable[JoulesRow]) -> dict[str, float]:
    """Joules of each activity, and of all."""
    held = list(rows)
    sums: dict[str, float] = {each: sum(row.joules for row in held if row.activity == each) for each in ACTIVITIES}
    return {**sums, "total": sum(sums.values())}


def by_role(rows: Sequence[JoulesRow]) -> dict[str, dict[str, dict[str, float]]]:
    """`summary.json`'s: role -> how they were had -> activity -> joules."""
    held = dict.fromkeys((row.role, row.how) for row in rows)
    found: dict[str, dict[str, dict[str, float]]] = {}
    for role, how in held:
        found.setdefault(role, {})[how] = by_activity(row for row in rows if (row.role, row.how) == (role, how))
    return found
