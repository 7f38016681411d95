"""What a report tells of time, where link rates or the like are given."""

from __future__ import annotations

import math
from collections.abc import Mapping

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.battery import lives
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import with_beta
from jouleswarm.energy.times import Seconds, times
from jouleswarm.report.arms import labels
from jouleswarm.report.format import joules_text, number_text
from jouleswarm.report.table import Table
from jouleswarm.runs.run import Run


def seconds_tables(run: Run, energy: Energy) -> list[Table]:
    """Seconds of the stage, of each task and of the whole; none where nothing is given that tells of time."""
    return times_tables(run.facts, labels(run.scenario), energy)


def times_tables(facts: Mapping[str, Facts], names: Mapping[str, str], energy: Energy) -> list[Table]:
    """The same of any arms, by what they are called."""
    if not energy.tells_time:
        return []
    held, rows = {arm: times(each, with_beta(energy, each)) for arm, each in facts.items()}, []
    tasks = sorted({task for found in held.values() for task in found.tasks})
    for arm, name in names.items():
        found = held[arm]
        cells = [found.ml, *(found.tasks.get(task) for task in tasks), found.total]
        rows.append([name, *(_text(each) for each in cells), number_text(found.total.communication_s)])
    title = "Seconds to learn"
    if any(found.total.communication_s is None for found in held.values()):
        title += " (computing alone: communication is not known, give rates of all links in bit/s)"
    headings = ["arm", "stage", *(f"task {task}" for task in tasks), "all", "of that on links"]
    return [Table(title, headings, rows)]


def battery_tables(run: Run, energy: Energy) -> list[Table]:
    """How long robots' batteries last; none where no robot has one."""
    if not energy.has_battery:
        return []
    rows = []
    for arm, name in labels(run.scenario).items():
        held = lives(facts := run.facts[arm], with_beta(energy, facts))
        ends = {robot: math.inf if each.rounds is None else each.rounds for robot, each in held.items()}
        cells: list[str] = []
        for robot in (min(ends, key=ends.__getitem__), max(ends, key=ends.__getitem__)) if ends else ():
            after = "no end" if held[robot].rounds is None else f"{held[robot].rounds}"
            cells += [f"robot {robot}", joules_text(held[robot].round_j), after]
        rows.append([name, *(cells or ["-"] * 6)])
    headings = ["arm", "first empty", "a round", "after rounds", "last empty", "a round", "after rounds"]
    return [Table("Batteries, full as each arm begins", headings, rows)]


def _text(seconds: Seconds | None) -> str:
    if seconds is None:
        return "-"
    return number_text(seconds.computing_s if seconds.total_s is None else seconds.total_s)
