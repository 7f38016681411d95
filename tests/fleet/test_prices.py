"""Prices as they are named on the command line."""

import pytest

from common.errors import ConfigurationError
from common.settings import Energy
from fleet.prices import Prices, parse_beta, reprice


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
