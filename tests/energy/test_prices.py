"""Prices as they are named on the command line."""

import math
from typing import Any

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.repricing import Prices, parse_beta, reprice


def test_beta_is_a_number_of_one_or_more() -> None:
    assert parse_beta("2.5") == 2.5


@pytest.mark.parametrize("text", ["0.9", "nan", "inf", "much", ""])
def test_what_is_no_beta_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match=f"--beta {text}: expected a number of 1 or more"):
        parse_beta(text)


@pytest.fixture
def own(facts: Any) -> Scenario:
    energy = Energy(ul_bit_per_j=123.0, sidelink="via_base_station")
    scenario: Scenario = facts.scenario.model_copy(update={"energy": energy})
    return scenario


def test_without_prices_a_run_keeps_its_own(own: Scenario) -> None:
    assert reprice(own, Prices().changes, "run") == (own, "")


def test_an_intensity_is_a_price_like_others(own: Scenario) -> None:
    other, suffix = reprice(own, Prices(carbon_datacenter=350, carbon_robots=50.5).changes, "run")
    assert (other.energy.datacenter_g_per_kwh, other.energy.robots_g_per_kwh) == (350, 50.5)
    assert suffix == "-carbon-datacenter350-carbon-robots50.5"


def test_any_constant_can_be_another(own: Scenario) -> None:
    changes = ["energy.p0_w=700", "energy.sidelink=direct", "energy.beta=measured", 'energy.prices=["published"]']
    other, suffix = reprice(own, [*changes, ("energy.tk_batch_s", 0.5)], "run")
    energy = other.energy
    assert (energy.p0_w, energy.tk_batch_s, energy.sidelink, energy.beta) == (700, 0.5, "direct", "measured")
    assert energy.prices == ("published",)
    assert suffix == "-p0-w700-direct-beta-measured-prices-published-tk-batch-s0.5"
    assert own.energy.p0_w == 590  # the run's own stay


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("energy.p0_w=-1", "scenario run: energy.p0_w: Input should be greater than or equal to 0.000001, got -1"),
        ("energy.t0_batch_s=soon", "scenario run: energy.t0_batch_s: Input should be a valid number"),
        ("energy.watts=3", "scenario run: energy.watts: no such field"),
        ("energy.prices=[]", "scenario run: energy.prices: Tuple should have at least 1 item"),
        ('energy.prices=["literal", "literal"]', "got ['literal', 'literal'], expected each once"),
        ("meta.t0=3", "--set meta.t0=3: expected energy.KEY=VALUE; anything else needs another run"),
        ("energy.pue", "override 'energy.pue': expected section.key=value"),
    ],
)
def test_a_change_that_is_no_price_is_one_line(own: Scenario, change: str, says: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        reprice(own, [change], "run")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


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
        _ = prices.changes
