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
from jouleswarm.common.scenario.countries import Country, intensities
from jouleswarm.common.scenario.links import DATA_CENTER, LinkConstants, Links, missing
from jouleswarm.common.scenario.radio import Distance, Frames, Place, RadioStates
from jouleswarm.common.scenario.robots import OwnConstants, Robot
from jouleswarm.common.scenario.sections import Section, each_once
from jouleswarm.common.scenario.uncertain import Uncertain


class Energy(Section):
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
    _hours: tuple[float, ...] = PrivateAttr(())
    _places: dict[int, Place] = PrivateAttr(default_factory=dict)

    def for_fleet(self, robots: Iterable[Robot], links: Links | None, hours: tuple[float, ...] = ()) -> Self:
        """The same with what robots, links and hours have of their own.

        Raises:
            ConfigurationError: a robot is of a kind that there is not.
        """
        other = self.model_copy()
        other._own, other._places = {}, {}
        for robot in robots:
            if robot.position_m is not None:
                other._places[robot.id] = robot.position_m
            kind = self.kinds.get(robot.kind) if robot.kind is not None else OwnConstants()
            if kind is None:
                known = ", ".join(self.kinds) or "one of energy.kinds, which is empty"
                raise ConfigurationError(f"robot {robot.id}: its kind is {robot.kind!r}, expected {known}")
            if own := kind.own | robot.own:
                other._own[robot.id] = OwnConstants(**own)
        other._links, other._hours = links, hours
        return other

    @property
    def is_uniform(self) -> bool:
        """Whether counts by phase are enough for the bill: the paper's constants, the same for every robot and link."""
        more = self.loss, self.idle_w, self.datacenter_idle_w, self.motion_j, self.forward_j
        return not self._own and self._links is None and not any(more)

    @property
    def _all(self) -> tuple[Energy | OwnConstants, ...]:
        """These constants, and those that robots have of their own."""
        return self, *self._own.values()

    @property
    def has_battery(self) -> bool:
        """Whether any robot can run empty."""
        return any(each.battery_j is not None for each in self._all)

    @property
    def waits_cost(self) -> bool:
        """Whether waiting costs anybody anything."""
        return any((self.datacenter_idle_w, *(each.idle_w for each in self._all)))

    @property
    def tells_time(self) -> bool:
        """Whether anything is given that takes or costs time beside gradients: rates, motions, waiting."""
        fields = "ul_bit_per_s", "sl_bit_per_s", "dl_bit_per_s", "motion_s"
        given = [getattr(each, name) for each in self._all for name in fields]
        return self.waits_cost or any([*given, *(link.bit_per_s for link in (self._links or {}).values())])

    @property
    def hours(self) -> tuple[float, ...]:
        """gCO2e a kWh of each hour; empty without a table."""
        return self._hours

    @property
    def has_own_carbon(self) -> bool:
        """Whether any robot is charged elsewhere than the others."""
        return any(own.g_per_kwh is not None for own in self._own.values())

    def intensity_of(self, who: int | None) -> float | None:
        """gCO2e a kWh where a robot is charged, of 0 where the data center is, of None where robots are unless told:
        the number, else the country's; None: neither is given."""
        if who == DATA_CENTER:
            g_per_kwh, country = self.datacenter_g_per_kwh, self.datacenter_country
        else:
            g_per_kwh = (self if who is None else self.of(who)).robots_g_per_kwh
            country = self.robots_country
        return intensities()[country] if g_per_kwh is None and country is not None else g_per_kwh

    def of(self, robot: int) -> Energy:
        """The constants that hold for one robot; for the data center's own they are these."""
        if robot not in self._own:
            return self
        own = self._own[robot].own
        if "g_per_kwh" in own:
            own["robots_g_per_kwh"] = own.pop("g_per_kwh")
        return self.model_copy(update=own)

    def place(self, node: int) -> Place:
        """Where a robot, or 0 the base station, stands, in metres.

        Raises:
            ConfigurationError: the scenario does not tell.
        """
        if node == DATA_CENTER:
            if self.distance.base_station_m is None:
                raise ConfigurationError("price list distance: expected energy.distance.base_station_m = [x, y]")
            return self.distance.base_station_m
        if node in self._places:
            return self._places[node]
        if self.distance.row_spacing_m is None:
            raise ConfigurationError(
                f"price list distance: robot {node} has no position, expected position_m in its [[robots]], or "
                "energy.distance.row_spacing_m for robots in a row"
            )
        return (node - 1) * self.distance.row_spacing_m, 0.0

    def check_places(self, robots: Iterable[int]) -> None:
        """See that all stand somewhere, and no two at one place.

        Raises:
            ConfigurationError: which one does not.
        """
        taken: dict[Place, str] = {self.place(DATA_CENTER): "the base station"}
        for robot in robots:
            if (other := taken.setdefault(self.place(robot), f"robot {robot}")) != f"robot {robot}":
                x, y = self.place(robot)
                raise ConfigurationError(
                    f"price list distance: robot {robot} and {other} are both at ({x:g}, {y:g}) m, expected two places"
                )

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
