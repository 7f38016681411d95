"""What a process has computed and moved, whether a row tells of it or not: a round that is done again after a kill is
done twice and told once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from jouleswarm.common.meter.cells import Cell, Key

WORK, EVALUATION = "work", "evaluation"
"""In place of a direction: cells of batch gradients and motions, and of greedy episodes' motions, not of bytes."""

Phase = Literal["maml", "fl"]


class WorkRow(BaseModel):
    """Cumulative work of one process in one phase of an arm, for one task."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    client: str = Field(max_length=100)
    phase: Phase
    arm: str
    task: int
    gradients: int = Field(ge=0)
    """Batch gradients, without `gradients_query`."""
    gradients_query: int = Field(ge=0)
    """Of the data center, on B^(b)."""
    motions: int = Field(ge=0)
    """Of robots, to learn from."""
    evaluation_motions: int = Field(0, ge=0)
    """Of robots, in greedy episodes."""


class Tally:
    """Counts what is done at one place, the moment it is done; without a cell for nobody."""

    def __init__(self, cell: Cell | None = None, evaluation: Cell | None = None) -> None:
        self._cell, self._evaluation = cell or Cell(), evaluation or Cell()

    def gradients(self, plain: int = 1, query: int = 0) -> None:
        """Batch gradients have been computed."""
        self._cell.add(query, 0, messages=plain)

    def motion(self) -> None:
        """A motion has been made."""
        self._cell.add(0, 1, messages=0)

    def evaluation_motion(self) -> None:
        """One of a greedy episode."""
        self._evaluation.add(0, 1, messages=0)


_NOTHING = {"gradients": 0, "gradients_query": 0, "motions": 0}

TallyOf = Callable[[int], Tally]
"""The tally of a task."""


def nobody(task: int) -> Tally:
    """For who is not asked what it has done."""
    return Tally()


def work_keys(phase: Phase, arm: str, task: int) -> tuple[Key, Key]:
    """Where a process's counters hold what it has done there, and what it took to evaluate."""
    place = f"{phase}/{arm}/{task}"
    return ("", place, WORK), ("", place, EVALUATION)


def work_rows(client: str, items: Iterable[tuple[Key, Sequence[int]]]) -> list[WorkRow]:
    """What counted cells tell of the work of `client`."""
    held: dict[str, dict[str, int]] = {}
    for (_, place, what), (plain, query, motions) in items:
        if what == WORK and (plain or query or motions):
            done = {"gradients": plain, "gradients_query": query, "motions": motions}
            held.setdefault(place, dict(_NOTHING)).update(done)
        elif what == EVALUATION and motions:
            held.setdefault(place, dict(_NOTHING))["evaluation_motions"] = motions
    rows = []
    for place, done in held.items():
        phase, arm, task = place.split("/")
        rows.append(WorkRow.model_validate({"client": client, "phase": phase, "arm": arm, "task": task, **done}))
    return rows
