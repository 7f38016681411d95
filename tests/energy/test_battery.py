"""How long batteries last: by hand, and of the committed compact study."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.robots import Robot
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.battery import Life, lives
from jouleswarm.energy.facts import Facts, Flow, Work

COMPACT = Path(__file__).parents[2] / "results" / "compact" / "facts.csv"


def _facts(work: list[Work], flows: list[Flow]) -> Facts:
    return Facts("fl", "fl", 0, {}, known_flows=tuple(flows), known_work=tuple(work), known_sent=())


def test_a_compact_robot_round_is_50_43_j_and_10_kj_last_198_rounds() -> None:
    with COMPACT.open(newline="") as lines:
        row = next(row for row in csv.DictReader(lines) if row["arm"] == "fl" and row["task"] == "1")
    rounds, robots = float(row["rounds"]), int(row["robots"])
    work = [Work("fl", 1, robot, float(row["gradients_robots"]) / robots, 0, 0.0, rounds) for robot in (1, 2)]
    sent = float(row["sidelink_bytes"]) / robots
    flows = [
        Flow("fl", 1, Link.SIDELINK, f"agent-{one}", f"agent-{two}", rounds, sent, sent)
        for one, two in ((1, 2), (2, 1))
    ]
    for life in lives(_facts(work, flows), Energy(battery_j=10e3)).values():
        assert life.round_j == pytest.approx(50.43, abs=0.005)  # 20 x 2.04 J and 602 kB at 500 kb/J
        assert life.rounds == 198


def test_the_stage_before_and_each_robots_own_constants_count() -> None:
    work = [Work("ml", 1, 1, 0, 0, 0.0, 2, 40), Work("fl", 1, 1, 50, 0, 0.0, 10, 0), Work("fl", 1, 2, 50, 0, 0.0, 10)]
    robots = [Robot(id=1, battery_j=100, pk_w=2.0), Robot(id=2), Robot(id=3, battery_j=5)]
    energy = Energy(pk_w=1, tk_batch_s=1, motion_j=0.5).for_fleet(robots, None)
    # Robot 1: 40 motions are 20 J; a round is 5 x 2 J; (100 - 20) / 10 = 8. Robot 2 has no end, robot 3 did nothing.
    assert lives(_facts(work, []), energy) == {1: Life(100, 20, 10, 8)}


def test_what_costs_nothing_lasts_for_ever_and_what_costs_too_much_not_once() -> None:
    work = [Work("fl", 1, 1, 0, 0, 0.0, 3), Work("fl", 1, 2, 30, 0, 0.0, 3)]
    energy = Energy(pk_w=1, tk_batch_s=1, battery_j=9)
    assert {robot: life.rounds for robot, life in lives(_facts(work, []), energy).items()} == {1: None, 2: 0}


def test_a_battery_in_a_cluster_that_waits_is_refused_in_one_line() -> None:
    with pytest.raises(ConfigurationError) as error:
        load_scenario("toy", [("robots", [{"id": 2, "battery_j": 5}])])
    assert 'federation.on_missing is "wait" and a robot has battery_j' in str(error.value)
    assert "\n" not in str(error.value)


def test_with_a_battery_a_process_does_not_go_on_from_a_state_of_other_prices() -> None:
    told: list[str | tuple[str, object]] = ["federation.on_missing=proceed", "energy.battery_j=50"]
    one, other = (load_scenario("toy", [*told, f"energy.pk_w={watts}"]).determines for watts in (5, 6))
    assert one != other
    one, other = (load_scenario("toy", [f"energy.pk_w={watts}"]).determines for watts in (5, 6))
    assert one == other
