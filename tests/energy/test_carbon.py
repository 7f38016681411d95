"""Grams of CO2 equivalent by site, worked out by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.carbon import Carbon, carbon, has_carbon

COST = Cost(computing_datacenter_j=7.2e6, computing_robots_j=1.8e6)  # 2 kWh in the data center, 0.5 kWh on robots


def test_a_kilowatt_hour_is_3_6_megajoules() -> None:
    grams = carbon(COST, Energy(datacenter_g_per_kwh=350, robots_g_per_kwh=50))
    assert grams == pytest.approx((700.0, 25.0))  # 2 x 350 g, 0.5 x 50 g
    assert grams.total_g == pytest.approx(725.0)


def test_a_site_without_an_intensity_is_unknown_and_so_is_the_total() -> None:
    energy = Energy(datacenter_g_per_kwh=350)
    assert has_carbon(energy)
    assert carbon(COST, energy) == Carbon(pytest.approx(700.0), None)
    assert carbon(COST, energy).total_g is None


def test_without_any_intensity_there_is_nothing_to_show() -> None:
    assert not has_carbon(Energy())
    assert carbon(COST, Energy()) == (None, None)


def test_electricity_without_emissions_is_zero_and_known() -> None:
    energy = Energy(datacenter_g_per_kwh=0, robots_g_per_kwh=0)
    assert has_carbon(energy)
    assert carbon(COST, energy).total_g == 0


@given(st.floats(0, 1e9), st.floats(0, 1e9), st.floats(0, 2000, allow_subnormal=False))
def test_at_one_intensity_everywhere_grams_follow_the_total(uplink_j: float, downlink_j: float, g: float) -> None:
    bill = Bill(ml=Cost(uplink_j=uplink_j), fl=Cost(downlink_j=downlink_j))
    grams = carbon(bill, Energy(datacenter_g_per_kwh=g, robots_g_per_kwh=g))
    assert grams.total_g == pytest.approx(bill.total_j / 3.6e6 * g)
