"""Facts from a run directory small enough to count by hand (see `run`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.meter.meter import Meter, MeterRow
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.runs.run import Run
from jouleswarm.studies.collect import facts_of, first_round
from jouleswarm.studies.facts import Fact

NAME = "made-up"
TASKS = [{"id": 1, "map": "E . \n * . \n X ."}, {"id": 2, "map": "E . \n * * \n . X"}]
ROBOTS = {1: (1, 2), 2: (3, 4)}
WEIGHTS, EXPERIENCE, MODEL = 500, (100, 200, 300, 400), 60  # bytes; experience of meta-rounds 1 to 4


def center_rows(arm: str) -> list[RoundRow]:
    return [
        RoundRow(
            phase="maml", arm=arm, task=1, agent=0, round=round_, seconds=2.0, gradients=8,
            gradients_support=5, gradients_query=3, experience_bytes=size,
        )
        for round_, size in enumerate(EXPERIENCE, start=1)
    ]  # fmt: skip


def robot_rows(arm: str, task: int, rewards: list[tuple[float, float]], learned: bool) -> list[RoundRow]:
    return [
        RoundRow(
            phase="fl", arm=arm, task=task, agent=agent, round=round_, reward=reward, cluster_reward=40.0 + round_,
            rmse_m=0.5, gradients=20, seconds=1.0 + place, learned=learned if round_ == len(rewards) else None,
        )
        for round_, pair in enumerate(rewards, start=1)
        for place, (agent, reward) in enumerate(zip(ROBOTS[task], pair, strict=True))
    ]  # fmt: skip


def meter_rows(arms: dict[str, int]) -> list[MeterRow]:
    """The shared meta-stage of method maml, then weights exchanged in so many rounds of each task of each arm."""
    broker = Meter("broker")
    for size in EXPERIENCE:
        topic = topics.experience(NAME, "maml", 1, 1)
        broker.count("agent-1", topic, "in", size, size + 9)
        broker.count("datacenter", topic, "out", size, size + 9)
    for arm, rounds in arms.items():
        if arm != "fl":
            for agent in (1, 2, 3, 4):
                broker.count(f"agent-{agent}", topics.meta_model(NAME, arm), "out", MODEL, MODEL + 9)
        for task, pair in ROBOTS.items():
            for sender, neighbour in (pair, pair[::-1]):
                for _ in range(rounds):
                    topic = topics.weights(NAME, arm, task, sender)
                    broker.count(f"agent-{sender}", topic, "in", WEIGHTS, WEIGHTS + 9)
                    broker.count(f"agent-{neighbour}", topic, "out", WEIGHTS, WEIGHTS + 9)
    return broker.rows()


@pytest.fixture
def run() -> Run:
    """t0 = 4, adapted from 2 as well: 3, 2 and 4 rounds in the three arms; task 2 is not learned in fl."""
    scenario = scenario_from(
        {
            "name": NAME, "seed": 7, "world": {"rows": 3, "cols": 2}, "methods": ["maml", "fl"], "tasks": TASKS,
            "meta": {"t0": 4, "adapt_from": [2], "training_tasks": [1]},
        },
        NAME,
    )  # fmt: skip
    rows = center_rows("maml")
    rewards = [(0.0, 20.0), (40.0, 60.0), (60.0, 80.0), (90.0, 90.0)]
    lasting = {"maml-t2": 3, "maml": 2, "fl": 4}
    for arm, rounds in lasting.items():
        rows += robot_rows(arm, 1, rewards[:rounds], True)
        rows += robot_rows(arm, 2, rewards[:1] * rounds, arm != "fl")
    return Run(Path(), {"run": NAME}, scenario, rows, meter_rows(lasting), [], {"status": "complete"}, [])


def fact(run: Run, arm: str, task: int) -> Fact:
    (found,) = [each for each in facts_of(run) if (each.arm, each.task) == (arm, task)]
    return found


def test_there_is_a_fact_a_stage_meta_learning_first(run: Run) -> None:
    assert [(each.arm, each.t0, each.task) for each in facts_of(run)] == [
        ("maml-t2", 2, 0), ("maml-t2", 2, 1), ("maml-t2", 2, 2),
        ("maml", 4, 0), ("maml", 4, 1), ("maml", 4, 2),
        ("fl", 0, 1), ("fl", 0, 2),
    ]  # fmt: skip


def test_an_arm_from_the_last_meta_model_pays_for_the_whole_meta_stage(run: Run) -> None:
    found = fact(run, "maml", 0)
    assert (found.gradients_support, found.gradients_query) == (20, 12)
    assert (found.uplink_bytes, found.downlink_bytes) == (1000, 4 * MODEL)
    assert (found.rounds, found.robots, found.seconds) == (4, 4, 8)


def test_an_arm_from_a_meta_model_on_the_way_pays_for_the_rounds_until_then(run: Run) -> None:
    found = fact(run, "maml-t2", 0)
    assert (found.gradients_support, found.gradients_query) == (10, 6)
    assert (found.uplink_bytes, found.downlink_bytes) == (300, 4 * MODEL)
    assert (found.rounds, found.seconds) == (2, 4)


def test_a_tasks_own_stage_has_its_robots_gradients_and_sidelinks_only(run: Run) -> None:
    found = fact(run, "maml-t2", 1)
    assert found.gradients_robots == 3 * 2 * 20
    assert found.sidelink_bytes == found.sidelink_sent_bytes == 3 * 2 * WEIGHTS
    assert (found.uplink_bytes, found.downlink_bytes, found.gradients_support) == (0, 0, 0)
    assert (found.robots, found.links, found.seconds) == (2, 2, 6)  # the slower robot: 3 rounds of 2 s
    assert (found.reward, found.rmse_m, found.learned) == (43, 0.5, True)
    assert (found.motions, found.evaluation_motions) == (3 * 2 * run.scenario.learning.motions_per_round, None)


def test_beta_is_noted_where_the_data_center_measured_it(run: Run) -> None:
    assert fact(run, "maml", 0).beta is None
    rows = [row.model_copy(update={"beta": 2.5}) if row.agent == 0 else row for row in run.rows]
    measured = Run(run.path, run.manifest, run.scenario, rows, run.meter_rows, [], run.summary, [])
    assert [fact(measured, arm, task).beta for arm, task in (("maml", 0), ("fl", 1))] == [2.5, None]


def test_rounds_are_told_by_three_measures(run: Run) -> None:
    # Means over robots are 10, 50, 70, 90; over a window of 3: 10, 30, 43.3, 70. The target is 50.
    found = fact(run, "fl", 1)
    assert (found.rounds, found.rounds_first, found.rounds_w3) == (4, 2, 4)


def test_r_is_noted_round_by_round_where_every_round_from_0_on_tells_it(run: Run) -> None:
    assert fact(run, "maml", 1).rewards == ""  # rows begin at round 1
    first = [row.model_copy(update={"round": 0, "cluster_reward": -3.25}) for row in run.rows if row.round == 1]
    whole = Run(run.path, run.manifest, run.scenario, [*first, *run.rows], run.meter_rows, [], run.summary, [])
    assert fact(whole, "maml", 1).rewards == "-3.25 41 42"
    assert fact(whole, "maml", 0).rewards == ""


def test_rounds_of_robots_whose_values_ran_away_are_counted(run: Run) -> None:
    far = [row.model_copy(update={"ran_away": 9e5}) if (row.agent, row.round) in {(1, 1), (2, 1), (1, 2)} else row
           for row in run.rows]  # fmt: skip
    away = Run(run.path, run.manifest, run.scenario, far, run.meter_rows, [], run.summary, [])
    assert [fact(each, "fl", 1).ran_away for each in (run, away)] == [0, 3]
    assert fact(away, "fl", 2).ran_away == 0  # robots 3 and 4


def test_a_task_that_was_not_learned_stays_with_the_rounds_it_ran(run: Run) -> None:
    found = fact(run, "fl", 2)
    assert (found.learned, found.rounds, found.rounds_first, found.rounds_w3) == (False, 4, 4, 4)


@pytest.mark.parametrize(("window", "expected"), [(1, 2), (2, 4), (3, None)])
def test_the_first_round_is_by_the_mean_over_robots_and_window(window: int, expected: int | None) -> None:
    # Means 10, 50, 40, 60, 10; over 2: 10, 30, 45, 50, 35; over 3: 10, 30, 33.3, 50 at round 4
    rewards = [[0.0, 20.0], [50.0, 50.0], [40.0, 40.0], [60.0, 60.0], [10.0, 10.0]]
    target = 50.0 if window < 3 else 50.1
    assert first_round(rewards, target, window) == expected


def test_methods_that_the_data_center_serves_have_its_part_in_every_tasks_stage() -> None:
    scenario = scenario_from(
        {"name": NAME, "world": {"rows": 3, "cols": 2}, "methods": ["centralized"], "tasks": TASKS}, NAME
    )
    served: list[dict[str, Any]] = [{"agent": 0, "gradients": 20}, {"agent": 1}, {"agent": 2}]
    rows = [RoundRow(phase="fl", arm="centralized", task=1, round=1, seconds=1.0, **each) for each in served]
    broker = Meter("broker")
    for task, size in ((1, 70), (2, 900)):
        topic = topics.transition(NAME, "centralized", task, 1)
        broker.count("datacenter", topic, "out", size, size)
        broker.count("agent-1", topics.cluster_model(NAME, "centralized", task), "out", size + 1, size + 1)
    run = Run(Path(), {"run": NAME}, scenario, rows, broker.rows(), [], {"status": "complete"}, [])
    found = fact(run, "centralized", 1)
    assert (found.gradients_support, found.gradients_robots) == (20, 0)
    assert (found.uplink_bytes, found.downlink_bytes, found.links) == (70, 71, 0)
