"""Constants that are ranges: what they come to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.uncertain import Uncertain
from jouleswarm.energy.facts import Counts
from jouleswarm.energy.literal import price
from jouleswarm.energy.uncertain import bills, draw, interval, pays, quantile

UP = Counts(uplink_bytes=1e6, gradients_robots=7)


def _energy(**constants: object) -> Energy:
    return Energy.model_validate(constants)


def test_a_uniform_efficiency_costs_the_mean_of_its_inverse() -> None:
    drawn = list(draw(_energy(ul_bit_per_j={"low": 100e3, "high": 400e3})))
    joules = bills({"up": lambda energy: price(Counts(uplink_bytes=1e6), energy).total_j}, drawn)["up"]
    # E[1/E_UL] = ln(b/a) / (b - a): 8e6 bit x ln(4) / 300e3
    assert joules.mean() == pytest.approx(8e6 * math.log(4) / 300e3, rel=1e-5)
    found = interval(joules)
    # 2.5% and 97.5% of E_UL are 107.5 and 392.5 kb/J
    assert (found.low, found.high) == (pytest.approx(8e6 / 392.5e3, rel=1e-3), pytest.approx(8e6 / 107.5e3, rel=2e-3))


def test_a_range_of_no_width_gives_the_bill_without_draws_to_the_digit() -> None:
    energy = _energy(ul_bit_per_j={"low": 123e3, "high": 123e3}, pk_w={"low": 5.1, "likely": 5.1, "high": 5.1})
    joules = bills({"up": lambda each: price(UP, each).total_j}, list(draw(energy, draws=50)))["up"]
    exact = price(UP, Energy(ul_bit_per_j=123e3)).total_j
    assert interval(joules) == (exact, exact, exact)


def test_the_same_seed_draws_the_same_and_each_share_once() -> None:
    energy = _energy(pk_w={"low": 4, "high": 6})
    drawn = [each.pk_w for each in draw(energy, draws=20)]
    assert drawn == [each.pk_w for each in draw(energy, draws=20)]
    assert sorted(int((watts - 4) * 10) for watts in drawn) == list(range(20))


def test_the_middle_of_each_shape() -> None:
    half = np.array([0.5])
    assert quantile(Uncertain(low=1, high=9), half) == pytest.approx(5)
    assert quantile(Uncertain(low=1, high=9, shape="loguniform"), half) == pytest.approx(3)
    # half of the triangle (0, 10, 10) lies below 10 / sqrt(2)
    assert quantile(Uncertain(low=0, high=10, likely=10), half) == pytest.approx(10 / math.sqrt(2))
    assert quantile(Uncertain(low=0, high=10, likely=0), half) == pytest.approx(10 - 10 / math.sqrt(2))


def test_how_often_one_is_cheaper() -> None:
    assert pays(np.array([1.0, 2.0, 3.0, 4.0]), np.array([2.0, 2.0, 2.0, 5.0])) == (2 + 0.5) / 4


def test_the_bill_without_draws_has_the_likely_value_or_the_middle() -> None:
    energy = load_scenario("toy", ["energy.ul_bit_per_j={low=100e3,high=400e3}"]).energy
    assert energy.ul_bit_per_j == 250e3
    assert Energy.model_validate(energy.model_dump()) == energy
    assert _energy(pk_w={"low": 1, "likely": 2, "high": 9}).pk_w == 2
    assert _energy(pk_w={"low": 1, "high": 9, "shape": "loguniform"}).pk_w == 3


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("energy.ul_bit_per_j={low=-1,high=4}", "energy.ul_bit_per_j: Input should be greater than"),
        ("energy.pk_w={low=5,high=4}", "got low 5, likely None, high 4; expected that order"),
        ("energy.pk_w={low=1,high=4,likely=9}", "expected that order"),
        ("energy.uncertain.foo={low=3,high=4}", "uncertain.foo: expected the name of a number of this section"),
        ("energy.pue={low=1,high=2,shape='normal'}", "uniform"),
    ],
)
def test_a_range_that_cannot_be_is_refused_in_one_line(override: str, said: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        load_scenario("toy", [override])
    assert said in str(error.value)
    assert "\n" not in str(error.value)
