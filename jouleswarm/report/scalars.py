"""A run as series over rounds, for programs that draw such: R, rewards, joules, bits."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import NamedTuple

from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.runs.curves import SPENT, curves
from jouleswarm.runs.directory import TIMES
from jouleswarm.runs.run import Run


class Scalar(NamedTuple):
    """One value of a series of an arm."""

    name: str
    value: float
    round: int
    time_s: float
    """Since 1970: when the round's last row came; of a run without times 0."""


def scalars(run: Run, arm: str) -> Iterator[Scalar]:
    """`R/task-1`, `reward/robot-3`, `gradients/robot-3` by round of the tasks, and `spent/joules` and the like of the
    whole arm, its stage before included."""
    times = _times(run, arm)
    for row in run.rows:
        if (row.arm, row.phase) != (arm, RowPhase.FL) or not row.agent:
            continue
        at, robot = times.get(row.round, 0.0), f"robot-{row.agent}"
        if row.agent == run.scenario.cluster(row.task)[0] and row.cluster_reward is not None:
            yield Scalar(f"R/task-{row.task}", row.cluster_reward, row.round, at)
        if row.reward is not None:
            yield Scalar(f"reward/{robot}", row.reward, row.round, at)
        yield Scalar(f"gradients/{robot}", float(row.gradients), row.round, at)
    points = curves(run, run.scenario.energy)
    for point in points[points["arm"] == arm].to_dict("records"):
        for name in (*SPENT, "share_learned"):
            value = point[name]
            if value is not None and math.isfinite(value):
                round_ = int(point["round"])
                yield Scalar(f"spent/{name}" if name in SPENT else name, float(value), round_, times.get(round_, 0.0))


def _times(run: Run, arm: str) -> dict[int, float]:
    found: dict[int, float] = {}
    for line in whole_lines(run.path / TIMES, mend=False):
        row = json.loads(line)
        if (row["arm"], row["phase"]) == (arm, RowPhase.FL):
            found[row["round"]] = max(found.get(row["round"], 0.0), row["time_s"])
    return found
