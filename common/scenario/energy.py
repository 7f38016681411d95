"""The section of the energy model's constants."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from jouleswarm.common.errors import ConfigurationError
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
from jouleswarm.common.scenario.links import DATA_CENTER, LinkConstants, Links, missing
from jouleswarm.common.scenario.robots import OwnConstants, Robot
from jouleswarm.common.scenario.sections import Section, each_once
from jouleswarm.common.scenario.uncertain import Uncertain


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
    idle_w: IdleWatts = Field(0.0, description="power of a robot that waits")
    datacenter_idle_w: IdleWatts = Field(0.0, description="power of the data center while it waits, before gamma")
    motion_j: Joules = Field(0.0, description="of one motion of a robot, evaluation's motions too")
    motion_s: Duration = Field(0.0, description="time of one motion")
    forward_j: Joules = Field(
        0.0, description="of one forward pass of a robot: each motion of a greedy episode has one"
    )
    battery_j: Joules | None = Field(None, description="what a robot's battery holds; default: no end")
    kinds: dict[str, OwnConstants] = Field(
        {}, description="[energy.kinds.NAME]: constants of a kind of robots, that [[robots]] name by `kind`"
    )
    uncertain: dict[str, Uncertain] = Field(
        {},
        description="constants that are not known exactly, by name: KEY = {low = 1, high = 2} in place of a number "
        "does the same; with likely, triangular; with shape = 'loguniform', so in the logarithm",
    )
    datacenter_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the data center is")
    robots_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the robots are charged")

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
        ranges = {name: Uncertain.model_validate(value) for name, value in found.items()}
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

    _own: dict[int, OwnConstants] = PrivateAttr(default_factory=dict)
    _links: Links | None = PrivateAttr(None)

    def for_fleet(self, robots: Iterable[Robot], links: Links | None) -> Self:
        """The same with what robots and links have of their own.

        Raises:
            ConfigurationError: a robot is of a kind that there is not.
        """
        other = self.model_copy()
        other._own = {}
        for robot in robots:
            kind = self.kinds.get(robot.kind) if robot.kind is not None else OwnConstants()
            if kind is None:
                known = ", ".join(self.kinds) or "one of energy.kinds, which is empty"
                raise ConfigurationError(f"robot {robot.id}: its kind is {robot.kind!r}, expected {known}")
            if own := kind.own | robot.own:
                other._own[robot.id] = OwnConstants(**own)
        other._links = links
        return other

    @property
    def is_uniform(self) -> bool:
        """Whether counts by phase are enough for the bill: the paper's constants, the same for every robot and link."""
        return self.is_alike and not (self.motion_j or self.forward_j)

    @property
    def is_alike(self) -> bool:
        """Whether every robot and link has the same constants, and what was counted by phase is all that is paid."""
        more = self.loss, self.idle_w, self.datacenter_idle_w
        return not self._own and self._links is None and not any(more)

    def of(self, robot: int) -> Energy:
        """The constants that hold for one robot; for the data center's own they are these."""
        if robot not in self._own:
            return self
        own = self._own[robot].own
        if "g_per_kwh" in own:
            own["robots_g_per_kwh"] = own.pop("g_per_kwh")
        return self.model_copy(update=own)

    def link(self, sender: int, receiver: int) -> LinkConstants:
        """The constants of a link, by the numbers of its ends; 0 is the data center.

        From the table where there is one, else by its class: uplink, downlink or sidelink.

        Raises:
            ConfigurationError: there is a table, and this link is not in it.
        """
        if self._links is not None:
            if (sender, receiver) not in self._links:
                raise missing(self._links, sender, receiver)
            return self._links[sender, receiver]
        here = self.of(receiver if sender == DATA_CENTER else sender)
        if receiver == DATA_CENTER:
            bit_per_j, bit_per_s = here.ul_bit_per_j, here.ul_bit_per_s
        elif sender == DATA_CENTER:
            bit_per_j, bit_per_s = here.dl_bit_per_j or here.ul_bit_per_j, here.dl_bit_per_s or here.ul_bit_per_s
        else:
            bit_per_j, bit_per_s = here.sl_bit_per_j, here.sl_bit_per_s
        return LinkConstants(bit_per_j=bit_per_j, bit_per_s=bit_per_s, loss=self.loss)
