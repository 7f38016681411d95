"""Rows of the joules that a process measures of itself, by phase, arm and activity: a list that no price touches."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from jouleswarm.common.meter.cells import Key
from jouleswarm.common.meter.joule_meter import JOULES

Activity = Literal["start", "learning", "communication", "idle"]
ACTIVITIES: tuple[Activity, ...] = ("start", "learning", "communication", "idle")
"""Until an arm's first round: joining, building networks; motions, gradients and evaluation; all else: coding, sending,
taking, mixing, remembering; waiting for a message."""

_N = 1_000_000_000


class JoulesRow(BaseModel):
    """What one process drew in one activity of an arm's phase, cumulative."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    client: str = Field(max_length=100)
    role: Literal["robot", "datacenter"]
    phase: Literal["", "maml", "fl"]
    arm: str = Field(max_length=300)
    activity: Activity
    seconds: float = Field(ge=0, allow_inf_nan=False)
    cpu_s: float = Field(ge=0, allow_inf_nan=False)
    joules: float = Field(ge=0, allow_inf_nan=False)
    how: str = Field(max_length=100)


def joules_rows(client: str, items: Iterable[tuple[Key, Sequence[int]]]) -> list[JoulesRow]:
    """What counted cells tell of the joules of `client`."""
    rows = []
    for (_, place, what), (wall, nj, cpu) in items:
        if what == JOULES:
            phase, arm, activity, how = place.split("/", 3)
            role = "datacenter" if client == "datacenter" else "robot"
            told = {"phase": phase, "arm": arm, "activity": activity, "how": how}
            drawn = {"seconds": wall / _N, "cpu_s": cpu / _N, "joules": nj / _N}
            rows.append(JoulesRow.model_validate({"client": client, "role": role, **told, **drawn}))
    return rows
