"""From how many tasks on, or how many returns of one, learning a model in the data center first pays. Pure.

Of M tasks the data center has learned from Q, which are seen; M - Q are not, and save less.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Savings(NamedTuple):
    """Joules of the stage before, and what a task saves by it: its own learning without, less that with it."""

    stage_j: float
    """Learning the model: eq. (8) without what goes down to the robots of a task, which is the task's."""
    seen_j: float
    """Saved by a task that the data center has learned from; negative where it costs more."""
    unseen_j: float
    """Saved by any other."""
    seen_tasks: int
    """Q."""


def tasks_to_pay(savings: Savings) -> float:
    """M*: with more tasks than this it pays; infinite where no number of tasks is enough.

    stage_j = min(M, Q) seen_j + max(M - Q, 0) unseen_j. Among the seen tasks alone M* may be a fraction of Q.
    """
    stage_j, seen_j, unseen_j, seen = savings
    if seen_j > 0 and seen * seen_j >= stage_j:
        return stage_j / seen_j
    if unseen_j <= 0:
        return math.inf
    return seen + (stage_j - seen * seen_j) / unseen_j


def returns_to_pay(savings: Savings) -> float:
    """How often seen tasks must come back, each learned anew, until their savings pay for the stage; may be infinite.

    The continual case: tasks return, and none is new.
    """
    return savings.stage_j / savings.seen_j if savings.seen_j > 0 else math.inf


def gain(savings: Savings, tasks: float, plain_j: float) -> float:
    """Joules of `tasks` tasks without over those with the stage; above 1 it pays.

    Args:
        savings: as above.
        tasks: M.
        plain_j: of one task without.
    """
    seen = min(tasks, savings.seen_tasks)
    saved_j = seen * savings.seen_j + (tasks - seen) * savings.unseen_j
    return tasks * plain_j / (savings.stage_j + tasks * plain_j - saved_j)
