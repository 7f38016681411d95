"""The rows of one arm, and what its settings come to for each task."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from jouleswarm.energy.facts import STAGE, Phase
from jouleswarm.energy.rows import COUNTS, Row


class ArmRows:
    """The rows of one arm; its robots are numbered from 1 in the order of the tasks."""

    def __init__(self, rows: Sequence[Row], arm: str) -> None:
        self.name = arm
        mine = [row for row in rows if row.arm in ("", arm)]
        self._given = {(row.arm, row.task, row.what): row.value for row in mine}
        self.counted = [row for row in mine if row.what in COUNTS]
        tasks = {row.task for row in mine if row.task is not None and row.phase == "fl"}
        self.tasks = sorted(tasks) or [1]
        self.has_clusters = any(row.what in ("model_bytes", "batches", "robots") for row in mine)
        self.clusters: dict[int, list[int]] = {}
        labels = {
            (row.task, row.robot, row.round) for row in self.counted if row.round is not None and row.phase == "fl"
        }
        self._labelled: dict[int | None, int] = {}
        for (task, _), count in Counter(label[:2] for label in labels).items():
            self._labelled[task] = max(count, self._labelled.get(task, 0))
        first = 1
        for task in self.tasks:
            self.clusters[task] = list(range(first, first := first + int(self.of("robots", task) or 1)))

    def of(self, what: str, task: int | None = None) -> float:
        """A setting as it is told nearest; 0 where it is not."""
        return self.told(what, task) or 0.0

    def told(self, what: str, task: int | None = None) -> float | None:
        """The same; None where it is not."""
        places = ((self.name, task), (self.name, None), ("", task), ("", None))
        return next((found for arm, at in places if (found := self._given.get((arm, at, what))) is not None), None)

    def rounds(self, task: int | None) -> float:
        """t_i as it is told; else the most rounds that a robot's counts are labelled with."""
        told = self.told("rounds", task)
        own = (count for of, count in self._labelled.items() if task is None or of in (None, task))
        return max(own, default=0) if told is None else told

    @property
    def robots(self) -> list[int]:
        """Of all clusters."""
        return [robot for cluster in self.clusters.values() for robot in cluster]

    def counts(self, phase: Phase, ending: str) -> bool:
        """Whether any such thing was counted in a phase."""
        return any(row.phase == phase and row.what.endswith(ending) for row in self.counted)

    def cluster(self, task: int | None) -> list[int]:
        """Who nobody in particular is: a task's robots, or all."""
        return self.robots if task is None else self.clusters.get(task, self.robots)

    def place(self, row: Row) -> int:
        """The task that a counted row is booked for: its own, or the only one there is; else all together."""
        return row.task or (self.tasks[0] if len(self.tasks) == 1 and row.phase == "fl" else STAGE)
