"""What a process has computed and moved, whether a row tells of it or not: a round that is done again after a kill is
done twice and told once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from jouleswarm.common.meter.counters import Cell, Key

WORK = "work"
"""In place of a direction: a cell of batch gradients and motions, not of bytes."""

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
    """Of robots, to learn from; greedy episodes are none."""


class Tally:
    """Counts what is done at one place, the moment it is done; without a cell for nobody."""

    def __init__(self, cell: Cell | None = None) -> None:
        self._cell = Cell() if cell is None else cell

    def gradients(self, plain: int = 1, query: int = 0) -> None:
        """Batch gradients have been computed."""
        self._cell.add(query, 0, messages=plain)

    def motion(self) -> None:
        """A motion has been made."""
        self._cell.add(0, 1, messages=0)


TallyOf = Callable[[int], Tally]
"""The tally of a task."""


def nobody(task: int) -> Tally:
    """For who is not asked what it has done."""
    return Tally()


def work_key(phase: Phase, arm: str, task: int) -> Key:
    """Where a process's counters hold what it has done there."""
    return "", f"{phase}/{arm}/{task}", WORK


def work_rows(client: str, items: Iterable[tuple[Key, Sequence[int]]]) -> list[WorkRow]:
    """What counted cells tell of the work of `client`."""
    rows = []
    for (_, place, what), (plain, query, motions) in items:
        if what == WORK and (plain or query or motions):
            phase, arm, task = place.split("/")
            row = {"phase": phase, "arm": arm, "task": task, "gradients": plain}
            rows.append(WorkRow.model_validate({"client": client, **row, "gradients_query": query, "motions": motions}))
    return rows
