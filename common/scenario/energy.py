"""The section energy: constants for all, and what single robots, links and hours have of their own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

from pydantic import PrivateAttr

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.constants import Constants
from jouleswarm.common.scenario.countries import intensities
from jouleswarm.common.scenario.links import DATA_CENTER, LinkConstants, Links, missing
from jouleswarm.common.scenario.radio import Place
from jouleswarm.common.scenario.robots import OwnConstants, Robot


class Energy(Constants):
    """Price lists, and the constants of the energy model (Table I). kb = 1000 bit."""

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
        return self.is_alike and not (self.motion_j or self.forward_j)

    @property
    def is_alike(self) -> bool:
        """Whether every robot and link has the same constants, and what was counted by phase is all that is paid."""
        more = self.loss, self.idle_w, self.datacenter_idle_w
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
