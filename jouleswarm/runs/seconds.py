"""How long each arm takes to learn, from facts and rates: see `energy.times`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.times import Seconds, times


def seconds_parts(facts: Facts, energy: Energy) -> dict[str, Any]:
    """An arm's seconds under the names of `summary.json`; `energy.beta` is a number. Null is what is not known."""
    found = times(facts, energy)
    return {
        "ml": None if found.ml is None else _parts(found.ml),
        "tasks": {str(task): _parts(each) for task, each in found.tasks.items()},
        "total": _parts(found.total, ("computing_s", "communication_s", "total_s")),
    }


def front(points: Mapping[str, tuple[float, float]]) -> list[str]:
    """Names of the points that no other one is as good as in both numbers and better in one, the fewest first
    numbers first (Pareto)."""
    found: list[str] = []
    for name, point in sorted(points.items(), key=lambda each: each[1]):
        if not found or point[1] < points[found[-1]][1] or point == points[found[-1]]:
            found.append(name)
    return found


_TOLD = ("rounds", "computing_s", "communication_s", "total_s", "round_s")


def _parts(seconds: Seconds, names: tuple[str, ...] = _TOLD) -> dict[str, float | None]:
    return {name: getattr(seconds, name) for name in names}
