"""Grams of CO2 equivalent: joules at each site times the carbon intensity of the electricity there."""

from __future__ import annotations

from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill, Cost

JOULES_PER_KWH = 3.6e6


class Carbon(NamedTuple):
    """Grams of CO2 equivalent by site; None where the intensity is not known, which is not nothing."""

    datacenter_g: float | None
    robots_g: float | None

    @property
    def total_g(self) -> float | None:
        """Both sites, if both are known."""
        if self.datacenter_g is None or self.robots_g is None:
            return None
        return self.datacenter_g + self.robots_g


def has_carbon(energy: Energy) -> bool:
    """Whether any site has an intensity, so that there is something to show."""
    return energy.datacenter_g_per_kwh is not None or energy.robots_g_per_kwh is not None


def carbon(cost: Cost | Bill, energy: Energy) -> Carbon:
    """`cost` in grams: J / 3.6e6 (J/kWh) x g/kWh at each site; not known where the price list tells no sites."""
    if (cost.both if isinstance(cost, Bill) else cost).untold_j:
        return Carbon(None, None)
    return Carbon(
        datacenter_g=_grams(cost.datacenter_j, energy.datacenter_g_per_kwh),
        robots_g=_grams(cost.robots_j, energy.robots_g_per_kwh),
    )


def _grams(joules: float, g_per_kwh: float | None) -> float | None:
    return None if g_per_kwh is None else joules / JOULES_PER_KWH * g_per_kwh
