"""The constants of the energy model, the same for all: the fields of the section energy."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from jouleswarm.common.scenario.bounds import (
    BatchSeconds,
    BetaFactor,
    BitRate,
    CarbonIntensity,
    Duration,
    Efficiency,
    IdleWatts,
    Joules,
    Loss,
    Pue,
    Watts,
)
from jouleswarm.common.scenario.countries import Country
from jouleswarm.common.scenario.radio import Distance, Frames, RadioStates
from jouleswarm.common.scenario.robots import OwnConstants
from jouleswarm.common.scenario.sections import Section, each_once
from jouleswarm.common.scenario.uncertain import Uncertain


class Constants(Section):
    """Price lists, and the constants of the energy model (Table I). kb = 1000 bit."""

    prices: tuple[str, ...] = Field(
        ("literal", "published"),
        min_length=1,
        max_length=20,
        description="price lists: literal (the equations), published (what the printed totals come to a round), "
        "distance, frames, radio_states (models of links, see docs/radio.md), or module:Class, a list of one's own "
        "(see docs/doors.md)",
    )
    p0_w: Watts = Field(590.0, description="P_0, data center power")
    t0_batch_s: BatchSeconds = Field(0.020, description="T_0, data center time of one batch gradient")
    pk_w: Watts = Field(5.1, description="P_k, robot power")
    tk_batch_s: BatchSeconds = Field(0.400, description="T_k, robot time of one batch gradient")
    pue: Pue = Field(1.67, description="gamma")
    base_station_pue: Pue | None = Field(None, description="gamma of eq. (11)'s E_kh = E_k0 + gamma E_0h; default pue")
    beta: BetaFactor | Literal["measured"] = Field(
        1.0, description="cost of an exact meta-gradient over a first-order one, or: measured by the data center"
    )
    ul_bit_per_j: Efficiency = Field(200e3, description="uplink efficiency E_UL, bit/J")
    sl_bit_per_j: Efficiency = Field(500e3, description="sidelink efficiency E_SL, bit/J")
    dl_bit_per_j: Efficiency | None = Field(None, description="default: as uplink (the paper gives none)")
    sidelink: Literal["direct", "via_base_station"] = Field(
        "direct", description="between robots, or up to the base station and down again, eq. (11)'s remark"
    )
    links: str | None = Field(
        None,
        min_length=1,
        max_length=1000,
        description="a table of links, NAME.csv beside the scenario: from, to (robots' numbers or datacenter), "
        "bit_per_j and, where wanted, j_per_message, bit_per_s, loss; every link that carries something is in it",
    )
    loss: Loss = Field(0.0, description="share of packets that is lost and sent again, on every link: joules/(1-p)")
    ul_bit_per_s: BitRate | None = Field(None, description="uplink rate; default: not known, and no seconds told")
    sl_bit_per_s: BitRate | None = Field(None, description="sidelink rate")
    dl_bit_per_s: BitRate | None = Field(None, description="downlink rate; default: as uplink")
    medium: Literal["shared", "own"] = Field(
        "shared", description="one channel a cluster, messages one after the other, or each link its own at once"
    )
    idle_w: IdleWatts = Field(0.0, description="power of a robot that waits for others, see docs/time.md")
    datacenter_idle_w: IdleWatts = Field(0.0, description="power of the data center while it waits, before gamma")
    motion_j: Joules = Field(0.0, description="of one motion of a robot, evaluation's motions too")
    motion_s: Duration = Field(0.0, description="time of one motion")
    forward_j: Joules = Field(
        0.0, description="of one forward pass of a robot: each motion of a greedy episode has one"
    )
    battery_j: Joules | None = Field(
        None,
        description="what a robot's battery holds as an arm begins; who cannot pay for another round stops",
    )
    kinds: dict[str, OwnConstants] = Field(
        {}, description="[energy.kinds.NAME]: constants of a kind of robots, that [[robots]] name by `kind`"
    )
    uncertain: dict[str, Uncertain] = Field(
        {},
        description="constants that are not known exactly, by name: KEY = {low = 1, high = 2} in place of a number "
        "does the same; with likely, triangular; with shape = 'loguniform', so in the logarithm",
    )
    distance: Distance = Distance()
    frames: Frames = Frames()
    radio_states: RadioStates = RadioStates()
    datacenter_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the data center is")
    robots_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the robots are charged")

    datacenter_country: Country | None = Field(
        None, description="two letters of ISO 3166-1, FI: its yearly average in place of datacenter_g_per_kwh"
    )
    robots_country: Country | None = Field(None, description="the same in place of robots_g_per_kwh")
    carbon_by_hour: str | None = Field(
        None,
        min_length=1,
        max_length=1000,
        description="a table of columns hour (0, 1, ...) and g_per_kwh, NAME.csv beside the scenario, for a site "
        "without number and country; after its last hour comes its first",
    )
    start_hour: float = Field(0.0, ge=0, le=8784, description="hour of that table in which an arm begins")

    _each_once = field_validator("prices")(each_once)

    @model_validator(mode="before")
    @classmethod
    def _ranges_apart(cls, given: Any) -> Any:
        """A range in place of a number: the number is its nominal value, and the range stands in `uncertain`."""
        if not isinstance(given, dict):
            return given
        found = {
            name: value
            for name, value in given.items()
            if isinstance(value, dict) and "low" in value and name != "kinds"
        }
        ranges = {name: _range(name, value) for name, value in found.items()}
        if not ranges:
            return given
        numbers = {name: spread.nominal for name, spread in ranges.items()}
        return given | numbers | {"uncertain": {**given.get("uncertain", {}), **ranges}}

    @model_validator(mode="after")
    def _ranges_are_in_bounds(self) -> Self:
        for name, spread in self.uncertain.items():
            if not isinstance(getattr(self, name, None), float):
                raise ValueError(f"uncertain.{name}: expected the name of a number of this section")
            for end in (spread.low, spread.high):
                type(self).__pydantic_validator__.validate_assignment(type(self).model_construct(), name, end)
        return self


def _range(name: str, given: object) -> Uncertain:
    try:
        return Uncertain.model_validate(given)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(level) for level in (name, *first["loc"]))
        raise ValueError(f"{where}: {first['msg'].removeprefix('Value error, ')}") from error
