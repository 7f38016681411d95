"""The section of the energy model's constants."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator

from jouleswarm.common.scenario.bounds import (
    BatchSeconds,
    BetaFactor,
    CarbonIntensity,
    Efficiency,
    Pue,
    Watts,
)
from jouleswarm.common.scenario.sections import Section, each_once


class Energy(Section):
    """Price lists, and the constants of the energy model (Table I). kb = 1000 bit."""

    prices: tuple[str, ...] = Field(
        ("literal", "published"),
        min_length=1,
        max_length=20,
        description="price lists: literal (the equations), published (what the printed totals come to a round), or "
        "module:Class, a list of one's own (see docs/doors.md)",
    )
    p0_w: Watts = Field(590.0, description="P_0, data center power")
    t0_batch_s: BatchSeconds = Field(0.020, description="T_0, data center time of one batch gradient")
    pk_w: Watts = Field(5.1, description="P_k, robot power")
    tk_batch_s: BatchSeconds = Field(0.400, description="T_k, robot time of one batch gradient")
    pue: Pue = Field(1.67, description="gamma")
    beta: BetaFactor | Literal["measured"] = Field(
        1.0, description="cost of an exact meta-gradient over a first-order one, or: measured by the data center"
    )
    ul_bit_per_j: Efficiency = Field(200e3, description="uplink efficiency E_UL, bit/J")
    sl_bit_per_j: Efficiency = Field(500e3, description="sidelink efficiency E_SL, bit/J")
    dl_bit_per_j: Efficiency | None = Field(None, description="default: as uplink (the paper gives none)")
    sidelink: Literal["direct", "via_base_station"] = Field(
        "direct", description="between robots, or up to the base station and down again, eq. (11)'s remark"
    )
    datacenter_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the data center is")
    robots_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the robots are charged")

    _each_once = field_validator("prices")(each_once)
