"""Grams by country, by robot and by hour, worked out by hand."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.hours import read_hours
from jouleswarm.common.scenario.reading import load_scenario, with_prices
from jouleswarm.common.scenario.robots import Robot
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.carbon import at_sites, carbon, has_carbon, mean_of_hours
from jouleswarm.energy.facts import Counts, Facts, Flow, Work
from jouleswarm.energy.literal import literal

HALF_AND_HALF = (100.0,) * 12 + (300.0,) * 12


def _facts() -> Facts:
    """Two robots, 1 kWh and 3 kWh of gradients at 1 W and 1 s each; nothing of what they send costs much."""
    work = (Work("fl", 1, 1, 3.6e6, 0, 0.0, 1), Work("fl", 1, 2, 10.8e6, 0, 0.0, 1))
    flows = (Flow("fl", 1, Link.SIDELINK, "agent-1", "agent-2", 1, 1000, 1000),)
    parts = {("fl", 1): Counts(gradients_robots=14.4e6)}
    return Facts("fl", "fl", 0, parts, {1: 1}, {1: 2}, {1: 2}, known_flows=flows, known_work=work, known_sent=())


def _energy(robots: list[Robot], hours: tuple[float, ...] = (), **more: object) -> Energy:
    told = {"pk_w": 1, "tk_batch_s": 1, "sl_bit_per_j": 1e15, **more}
    return Energy.model_validate(told).for_fleet(robots, None, hours)


def test_half_at_100_and_half_at_300_g_is_200_g_a_kilowatt_hour() -> None:
    assert mean_of_hours(HALF_AND_HALF, 0, 24 * 3600) == pytest.approx(200)
    energy = _energy([], HALF_AND_HALF)
    assert has_carbon(energy)
    assert carbon(literal.price(_facts(), energy), at_sites(energy)).robots_g == pytest.approx(4 * 200)


def test_with_known_seconds_the_hours_in_which_it_ran_count() -> None:
    # 10.8e6 s of the slowest robot are 3000 h, 125 days: the mean of a day. At 1e-3 of that time 3 h, from 11:00 on:
    # one hour at 100 and two at 300.
    quick = {"pk_w": 1e3, "tk_batch_s": 1e-3, "sl_bit_per_s": 1e15, "start_hour": 11}
    for energy, mean in (
        (_energy([], HALF_AND_HALF, sl_bit_per_s=1e15), 200),
        (_energy([], HALF_AND_HALF, **quick), 700 / 3),
    ):
        assert carbon(literal.price(_facts(), energy), at_sites(energy, _facts())).robots_g == pytest.approx(4 * mean)


def test_each_robot_is_charged_where_it_is() -> None:
    energy = _energy([Robot(id=2, g_per_kwh=500)], robots_g_per_kwh=100)
    assert carbon(literal.price(_facts(), energy), at_sites(energy, _facts())).robots_g == pytest.approx(100 + 3 * 500)
    unknown = _energy([Robot(id=2, g_per_kwh=500)])
    assert carbon(literal.price(_facts(), unknown), at_sites(unknown, _facts())).robots_g is None


def test_a_country_stands_for_its_yearly_average_and_a_number_comes_before_it() -> None:
    energy = at_sites(Energy(robots_country="FI", datacenter_country="FR", datacenter_g_per_kwh=1))
    assert (energy.robots_g_per_kwh, energy.datacenter_g_per_kwh) == (79.158, 1)


def test_a_country_that_there_is_not_is_refused_in_one_line() -> None:
    with pytest.raises(ConfigurationError, match=r"energy.robots_country: got 'XX', expected a country's two"):
        load_scenario("toy", ["energy.robots_country=XX"])


def test_a_table_of_hours_is_read_beside_the_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hours.csv").write_text("hour,g_per_kwh\n0,100\n1,300\n")
    monkeypatch.chdir(tmp_path)
    scenario = load_scenario("toy", ["energy.carbon_by_hour=hours.csv"])
    assert scenario.energy.hours == (100.0, 300.0)
    assert "hours.csv" in scenario.files
    assert with_prices(scenario, ["energy.start_hour=1"], "toy").energy.hours == (100.0, 300.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("hour;g\n", "its first line is 'hour;g', expected hour,g_per_kwh"),
        ("hour,g_per_kwh\n", "has no hour"),
        ("hour,g_per_kwh\n1,5\n", "line 2: got '1,5', expected hour 0 and its intensity"),
        ("hour,g_per_kwh\n0,-5\n", "line 2: Input should be greater than or equal to 0, got '-5'"),
        ("hour,g_per_kwh\n0,nan\n", "line 2: Input should be"),
    ],
)
def test_a_table_of_hours_that_cannot_be_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "hours.csv").write_text(text)
    with pytest.raises(ConfigurationError) as error:
        read_hours(tmp_path / "hours.csv")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@given(st.floats(0, 1e7), st.floats(1.0, 1e7), st.lists(st.floats(0, 1000), min_size=1, max_size=30))
def test_the_mean_lies_between_the_hours(begin_s: float, lasts_s: float, hours: list[float]) -> None:
    mean = mean_of_hours(tuple(hours), begin_s, begin_s + lasts_s)
    assert min(hours) - 1e-3 <= mean <= max(hours) + 1e-3
