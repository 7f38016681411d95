"""What one robot, or one kind of robot, has of its own: its round, and the constants of its bill."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from jouleswarm.common.scenario.bounds import (
    Batches,
    BatchSeconds,
    BitRate,
    CarbonIntensity,
    Duration,
    Efficiency,
    Id,
    IdleWatts,
    Joules,
    Metres,
    Motions,
    Watts,
)
from jouleswarm.common.scenario.sections import Section


class OwnConstants(Section):
    """Constants of the energy model in place of those of `[energy]`."""

    pk_w: Watts | None = Field(None, description="P_k")
    tk_batch_s: BatchSeconds | None = Field(None, description="T_k")
    idle_w: IdleWatts | None = Field(None, description="power while it waits")
    motion_j: Joules | None = Field(None, description="of one motion")
    motion_s: Duration | None = Field(None, description="time of one motion")
    ul_bit_per_j: Efficiency | None = Field(None, description="of its way up")
    sl_bit_per_j: Efficiency | None = Field(None, description="of what it sends to neighbours")
    dl_bit_per_j: Efficiency | None = Field(None, description="of the way down to it")
    ul_bit_per_s: BitRate | None = Field(None, description="rate of its way up")
    sl_bit_per_s: BitRate | None = Field(None, description="rate of what it sends to neighbours")
    dl_bit_per_s: BitRate | None = Field(None, description="rate of the way down to it")
    battery_j: Joules | None = Field(None, description="what its battery holds")
    g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where it is charged")

    @property
    def own(self) -> dict[str, Any]:
        """Those that are given."""
        return {name: value for name in OwnConstants.model_fields if (value := getattr(self, name)) is not None}


class Robot(OwnConstants):
    """What one robot has of its own, by its number; constants of its bill come before those of its kind."""

    id: Id = Field(description="its number: robots are numbered from 1 in the order of the tasks")
    motions_per_round: Motions | None = Field(None, description="|E_ik|; default its task's")
    batches_per_round: Batches | None = Field(None, description="B_ik; default its task's")
    kind: str | None = Field(None, max_length=100, description="one of energy.kinds, whose constants it has")
    position_m: tuple[Metres, Metres] | None = Field(None, description="where it stands, for links by distance")
