"""How a robot moves and what it brings, on a map whose returns can be worked out by hand.

The path is entry (0, 1), (1, 1), (2, 1), exit (3, 1): 3 motions forward, worth -0.5 - 2.5 x 2/3, -0.5 - 2.5 x 1/3, 80.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from jouleswarm.agents.explorer import Explorer
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import MotionHeader
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork
from tests.made_up import decode_motion, image

FORWARD, LEFT = 0, 2
FIRST, SECOND, EXIT = -0.5 - 2.5 * 2 / 3, -0.5 - 2.5 / 3, 80.0
BEST_RETURN = FIRST + 0.99 * SECOND + 0.99**2 * EXIT  # 74.921


def scenario(rewards: list[float] | None = None, **learning: object) -> Scenario:
    data = {
        "name": "t", "seed": 3,
        "world": {"rows": 4, "cols": 3, "max_motions": 10, "path_slope": 2.5, "off_path_reward": -1.5},
        "camera": {"width": 16, "height": 12},
        "network": {"width": 8, "height": 6, "conv": [], "dense": []},
        "learning": {
            "motions_per_round": 8, "epsilon": 0.0, "replay_size": 50, "collect": "own", "starts": "area", **learning
        },
        "methods": ["fl"],
        "meta": {"t0": 2, "training_tasks": [1], "epsilon": 0.0, "starts": learning.get("starts", "area")},
        "tasks": [{"id": 1, "map": ". E . \n . * . \n . * . \n . X .", "rewards": rewards}],
    }  # fmt: skip
    return scenario_from(data, "test")


def always(action: int, settings: Scenario) -> Learner:
    """A robot whose Q-function prefers one action everywhere."""
    bias = np.zeros(4, np.float32)
    bias[action] = 1.0
    weights: dict[str, npt.NDArray[np.float32]] = {"1.weight": np.zeros((4, 8 * 6 * 4), np.float32), "1.bias": bias}
    return Learner(build_qnetwork(settings), settings.learning, weights, np.random.default_rng(1))


def begun(settings: Scenario, agent: int = 1) -> Explorer:
    explorer = Explorer(settings, agent)
    explorer.begin("maml", settings.cluster(1))
    return explorer


def test_a_perfect_episode_returns_the_discounted_rewards_and_follows_the_path() -> None:
    settings = scenario()
    reward, measures, motions, _ = begun(settings).evaluate(always(FORWARD, settings))
    assert reward == pytest.approx(BEST_RETURN, abs=1e-4)
    assert measures == {"rmse_m": 0.0, "reached": 1.0}
    assert motions == 3  # from the entry, three rows on


def test_an_episode_that_never_arrives_pays_and_is_measured_against_the_path() -> None:
    settings = scenario()
    reward, measures, motions, _ = begun(settings).evaluate(always(LEFT, settings))
    # ten motions at (0, 0), one off the entry: -3 - 1.5 each
    assert reward == pytest.approx(-4.5 * (1 - 0.99**10) / (1 - 0.99), abs=1e-4)
    # (0, 1), then (0, 0) against (1, 1), (2, 1) and nine times... the path waits at (3, 1) for motions 3 to 10
    assert measures == pytest.approx({"rmse_m": math.sqrt((0 + 2 + 5 + 8 * 10) / 11), "reached": 0.0})
    assert motions == 10


def test_an_episode_that_never_arrives_never_counts_above_0() -> None:
    settings = scenario(rewards=[1.0] * 12)
    assert begun(settings).evaluate(always(LEFT, settings))[0] == 0.0
    assert begun(settings).evaluate(always(FORWARD, settings))[0] == pytest.approx(1 + 0.99 + 0.99**2)


def test_collecting_fills_the_memory_with_whole_transitions() -> None:
    settings = scenario(starts="entry")
    robot = always(FORWARD, settings)
    explorer = begun(settings)
    assert explorer.collect(robot, 8) == 8  # two whole episodes of 3 motions, and 2 motions
    assert len(robot.replay) == 8
    batch = robot.replay.sample(300, np.random.default_rng(0))
    assert set(batch.actions.tolist()) == {FORWARD}
    assert sorted(set(batch.rewards.tolist())) == pytest.approx(sorted([FIRST, SECOND, EXIT]), abs=1e-5)
    assert batch.terminated.tolist() == [float(reward == EXIT) for reward in batch.rewards.tolist()]


def test_an_episode_goes_on_in_the_next_round() -> None:
    settings = scenario(starts="entry")
    robot, explorer = always(FORWARD, settings), begun(settings)
    for _ in range(3):
        explorer.collect(robot, 1)
    batch = robot.replay.sample(300, np.random.default_rng(0))
    assert EXIT in batch.rewards.tolist()  # three rounds of one motion each have reached the exit


def test_a_truncated_episode_keeps_its_last_transition() -> None:
    settings = scenario(starts="entry")
    robot = always(LEFT, settings)
    begun(settings).collect(robot, 11)  # ten motions and a new episode's first
    assert len(robot.replay) == 11
    assert robot.replay.sample(300, np.random.default_rng(0)).terminated.max() == 0.0


def test_epsilon_1_moves_at_random() -> None:
    settings = scenario(epsilon=1.0)
    robot = always(FORWARD, settings)
    begun(settings).collect(robot, 50)
    assert set(robot.replay.sample(500, np.random.default_rng(0)).actions.tolist()) == {0, 1, 2, 3}


def test_the_same_arm_brings_the_same_to_the_bit_whatever_came_before() -> None:
    settings = scenario(epsilon=0.5, starts="anywhere")

    def collected(explorer: Explorer, arm: str) -> bytes:
        robot = always(FORWARD, settings)
        explorer.begin(arm, settings.cluster(1))
        explorer.collect(robot, 20)
        explorer.evaluate(robot)
        return b"".join(each.tobytes() for each in robot.replay.sample(100, np.random.default_rng(0)))

    fresh, used = Explorer(settings, 1), Explorer(settings, 1)
    list(used.motions(1))
    collected(used, "maml")
    assert collected(used, "fl") == collected(fresh, "fl")
    assert collected(fresh, "maml") != collected(fresh, "fl")


def read(payloads: list[bytes]) -> list[MotionHeader]:
    return [decode_motion(payload, image(12, 16))[1] for payload in payloads]


def test_experience_follows_the_best_policy_of_the_table_from_round_to_round() -> None:
    explorer = Explorer(scenario(starts="entry"), 1)
    one, two = read(list(explorer.motions(1))), read(list(explorer.motions(2)))
    assert [(each.task, each.agent, each.round, each.motion) for each in two] == [(1, 1, 2, m) for m in range(8)]
    assert [each.action for each in one + two] == [FORWARD] * 16
    # five episodes of three motions and a sixth's first; the first round ends two motions into the third
    rewards = [FIRST, SECOND, EXIT] * 5 + [FIRST]
    assert [each.reward for each in one + two] == pytest.approx(rewards, abs=1e-5)
    assert [each.first for each in one + two] == [True, False, False] * 5 + [True]
    assert [each.terminated for each in one + two] == [False, False, True] * 5 + [False]


def test_an_episode_that_goes_on_in_the_next_round_is_truncated_when_it_would_have_been() -> None:
    settings = scenario(rewards=[1.0] * 9 + [1.0, 0.0, 1.0], starts="entry")  # leaving is worth nothing
    settings = settings.model_copy(update={"world": settings.world.model_copy(update={"max_motions": 5})})
    explorer = Explorer(settings, 1)
    headers = [each for round_ in (1, 2, 3) for each in read(list(explorer.motions(round_)))]
    assert [index for index, each in enumerate(headers) if each.first] == [0, 5, 10, 15, 20]
    assert not any(each.terminated for each in headers)


def test_a_round_s_experience_is_the_same_whichever_round_was_asked_for_first() -> None:
    settings = scenario().model_copy(update={"meta": scenario().meta.model_copy(update={"epsilon": 0.5})})
    forwards, backwards = Explorer(settings, 1), Explorer(settings, 1)
    rounds = {round_: list(forwards.motions(round_)) for round_ in (1, 2, 3)}
    assert {round_: list(backwards.motions(round_)) for round_ in (3, 2, 1)} == rounds


def test_experience_for_a_learning_data_center_goes_on_where_the_round_before_ended() -> None:
    settings = scenario(starts="entry")
    explorer, policy = begun(settings), always(FORWARD, settings)
    headers = [each for round_ in (1, 2) for each in read(list(explorer.policy_motions(policy, round_)))]
    assert [each.first for each in headers] == [True, False, False] * 5 + [True]
    assert [each.terminated for each in headers] == [False, False, True] * 5 + [False]


def test_a_round_of_experience_asked_for_again_is_the_same_to_the_bit() -> None:
    settings = scenario().model_copy(update={"meta": scenario().meta.model_copy(update={"epsilon": 0.5})})
    explorer = Explorer(settings, 1)
    first, second = list(explorer.motions(1)), list(explorer.motions(2))
    assert list(explorer.motions(1)) == first
    assert [each.action for each in read(first)] != [each.action for each in read(second)]
    assert list(Explorer(settings, 1).motions(2)) == second


def test_robots_of_a_cluster_start_in_areas_of_their_own() -> None:
    # Landmark i, row by row, is worth i; an episode is one motion to the left.
    settings = scenario(rewards=[float(index) for index in range(12)])
    settings = settings.model_copy(update={"world": settings.world.model_copy(update={"max_motions": 1})})
    arrived = []
    for agent in (1, 2):
        robot = always(LEFT, settings)
        begun(settings, agent).collect(robot, 50)
        arrived.append(set(robot.replay.sample(1000, np.random.default_rng(0)).rewards.tolist()))
    # starts without the exit 10: 0 to 4 for the first robot, 5 to 9 and 11 for the second
    assert arrived == [{0, 1, 3}, {4, 6, 7, 9, 10}]


def test_a_robot_that_draws_small_sends_frames_as_large_as_before_and_does_not_depend_on_them() -> None:
    settings = scenario_from(
        {**scenario().model_dump(), "camera": {"width": 16, "height": 12, "draw": "input"}}, "test"
    )

    def learned(explorer: Explorer) -> list[Any]:
        explorer.begin("maml", settings.cluster(1))
        robot = always(FORWARD, settings)
        explorer.collect(robot, 12)
        return [part.tolist() for part in robot.replay.sample(20, np.random.default_rng(1))]

    explorer, fresh = Explorer(settings, 1), Explorer(settings, 1)
    sent = list(explorer.motions(1))
    assert len([decode_motion(payload, image(12, 16)) for payload in sent]) == 8
    after_sending = learned(explorer)
    assert after_sending == learned(fresh)  # as one that comes back when the others have sent
    assert list(explorer.motions(2)) == list(fresh.motions(2))


@pytest.mark.parametrize("motions", [1, 3, 8, 11])  # between episodes or in the middle of one
@pytest.mark.parametrize("sends", [False, True], ids=["into its own memory", "to the data center"])
def test_an_explorer_that_comes_back_goes_on_bit_by_bit(sends: bool, motions: int, tmp_path: Path) -> None:
    settings = scenario(epsilon=0.5, motions_per_round=motions)

    def next_round(explorer: Explorer) -> tuple[Any, ...]:
        learner = always(FORWARD, settings)
        if sends:
            return explorer.evaluate(learner), list(explorer.policy_motions(learner, 2))
        explorer.collect(learner, 9)
        batch = learner.replay.sample(20, np.random.default_rng(1))
        return explorer.evaluate(learner), [part.tolist() for part in batch]

    undisturbed = begun(settings)
    next_round(undisturbed)
    file = StateFile(tmp_path / "s.safetensors", "o")
    file.save(undisturbed.state())
    state, back = file.load(), begun(settings)
    assert state is not None
    back.load_state(state)
    for _ in range(2):
        assert next_round(back) == next_round(undisturbed)


def test_robots_follow_the_guide_whatever_they_are_learning() -> None:
    settings = scenario(collect="guide", starts="entry")
    robot, explorer = always(LEFT, settings), begun(settings)
    explorer.collect(robot, 6)
    batch = robot.replay.sample(300, np.random.default_rng(0))
    assert set(batch.actions.tolist()) == {FORWARD}
    assert sorted(set(batch.rewards.tolist())) == pytest.approx(sorted([FIRST, SECOND, EXIT]), abs=1e-5)
    headers = read(list(begun(settings).policy_motions(always(LEFT, settings), 1)))
    assert [each.action for each in headers] == [FORWARD] * 8


def test_guided_robots_move_the_same_to_the_bit_whatever_they_have_learned() -> None:
    settings = scenario(collect="guide", starts="anywhere", epsilon=0.5)

    def moved(action: int, agent: int = 1) -> list[int]:
        return [each.action for each in read(list(begun(settings, agent).policy_motions(always(action, settings), 1)))]

    assert moved(LEFT) == moved(FORWARD)
    assert moved(LEFT) != moved(LEFT, agent=2)


def test_a_guided_robot_takes_random_actions_at_the_rate_of_epsilon() -> None:
    settings = scenario(collect="guide", starts="entry", epsilon=0.4, motions_per_round=4000)
    headers = read(list(begun(settings).policy_motions(always(FORWARD, settings), 1)))
    # At the entry the guide goes forward: another action is drawn with 0.4 / 4, forward with 0.6 + 0.4 / 4.
    firsts = [each.action for each in headers if each.first]
    assert firsts.count(LEFT) / len(firsts) == pytest.approx(0.1, abs=0.03)
    assert firsts.count(FORWARD) / len(firsts) == pytest.approx(0.7, abs=0.05)


def test_experience_for_the_data_center_is_collected_as_robots_collect_unless_its_own_rule_is_said() -> None:
    held = scenario(collect="guide", starts="entry").model_dump()
    said = {**held, "meta": {**held["meta"], "epsilon": None, "starts": None}}
    alike = scenario_from(said, "test")
    assert (alike.meta_epsilon, alike.meta_starts) == (0.0, "entry")
    assert [each.action for each in read(list(Explorer(alike, 1).motions(1)))] == [FORWARD] * 8
    own = scenario_from({**said, "meta": {**said["meta"], "epsilon": 1.0, "starts": "anywhere"}}, "test")
    assert (own.meta_epsilon, own.meta_starts) == (1.0, "anywhere")
    assert {each.action for each in read(list(Explorer(own, 1).motions(1)))} != {FORWARD}
