"""Prices as they are named on the command line."""

import math

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.energy.prices import Prices, parse_beta, reprice


def test_beta_is_a_number_of_one_or_more() -> None:
    assert parse_beta("2.5") == 2.5


@pytest.mark.parametrize("text", ["0.9", "nan", "inf", "much", ""])
def test_what_is_no_beta_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match=f"--beta {text}: expected a number of 1 or more"):
        parse_beta(text)


def test_without_prices_a_run_keeps_its_own() -> None:
    own = Energy(ul_bit_per_j=123.0, sidelink="via_base_station")
    assert reprice(own, Prices()) == (own, "")


def test_an_intensity_is_a_price_like_others() -> None:
    energy, suffix = reprice(Energy(), Prices(carbon_datacenter=350, carbon_robots=50.5))
    assert (energy.datacenter_g_per_kwh, energy.robots_g_per_kwh) == (350, 50.5)
    assert suffix == "-carbon-datacenter350-carbon-robots50.5"


@pytest.mark.parametrize(
    ("prices", "message"),
    [
        (Prices(ul=5e-324), "--ul 4.94066e-324: expected a number from 1e-09 to 1e\\+12, in kb/J"),
        (Prices(sl=1e308), "--sl 1e\\+308: expected a number from 1e-09"),
        (Prices(dl=math.nan), "--dl nan: expected a number from 1e-09"),
        (Prices(pue=1e308), "--pue 1e\\+308: expected a number of 1 or more, up to 1000"),
        (Prices(carbon_robots=math.inf), "--carbon-robots inf: expected a number of 0 or more, up to 1e\\+06"),
    ],
)
def test_a_price_is_bounded_as_in_a_scenario(prices: Prices, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        reprice(Energy(), prices)
