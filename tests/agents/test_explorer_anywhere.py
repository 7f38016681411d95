"""A robot in environments that offer more or less, on a line of places whose rewards are their numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jouleswarm.agents.explorer import Explorer
from jouleswarm.codecs.observations import experience_codec_of
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.datacenter.experience import Motion, read_motion
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork, shapes_of

WORLDS = ("Line", "Known", "Looking", "Numbers", "Pictures")
GO = 1


def scenario(world: str, end: int = 4, **learning: Any) -> Scenario:
    data = {
        "name": "t", "seed": 3, "methods": ["fl"], "environment": f"tests.worlds:{world}",
        "network": {"dense": [], "conv": [], "width": 3, "height": 2},
        "learning": {
            "motions_per_round": 3, "epsilon": 0.0, "replay_size": 50, "collect": "own", "starts": "area", **learning
        },
        "meta": {"t0": 2, "training_tasks": [1], "epsilon": 0.0},
        "tasks": [{"id": 1, "kwargs": {"end": end}}],
    }  # fmt: skip
    return scenario_from(data, "test")


def always(action: int, settings: Scenario) -> Learner:
    """A robot whose Q-function prefers one action everywhere."""
    network = build_qnetwork(settings)
    weights = {name: np.zeros(shape, np.float32) for name, shape in shapes_of(network).items()}
    weights["1.bias"][action] = 1.0
    return Learner(network, settings.learning, weights, np.random.default_rng(1))


def begun(settings: Scenario) -> Explorer:
    explorer = Explorer(settings, 1)
    explorer.begin("fl", settings.cluster(1))
    return explorer


def sent(settings: Scenario, payloads: Any) -> list[Motion]:
    return [read_motion(payload, settings, experience_codec_of(settings)) for payload in payloads]


@pytest.mark.parametrize("world", WORLDS)
def test_an_evaluation_is_what_the_environment_judges(world: str) -> None:
    settings = scenario(world)
    reward, measures, *_ = begun(settings).evaluate(always(GO, settings))
    total = 1 + 0.99 * 2 + 0.99**2 * 3 + 0.99**3 * 4
    judged = world in ("Known", "Looking")
    assert reward == pytest.approx(2 * total if judged else total)
    assert measures == ({"place": 4.0} if judged else {})


def test_episodes_start_where_the_environment_says() -> None:
    settings = scenario("Known", end=100)
    learner = always(GO, settings)
    begun(settings).collect(learner, 3)  # from place 1
    assert sorted(set(learner.replay.sample(100, np.random.default_rng(0)).rewards.tolist())) == [2.0, 3.0, 4.0]


@pytest.mark.parametrize(("world", "goes_on"), [("Known", True), ("Looking", True), ("Line", False)])
def test_an_episode_goes_on_in_the_next_round_where_it_can(world: str, goes_on: bool) -> None:
    settings = scenario(world, end=100, starts="entry")
    learner, explorer = always(GO, settings), begun(settings)
    for _ in range(2):
        explorer.collect(learner, 3)
    rewards = learner.replay.sample(300, np.random.default_rng(0)).rewards.tolist()
    assert max(rewards) == (6.0 if goes_on else 3.0)
    assert len(learner.replay) == 6  # also the last one of a round that nothing follows


@pytest.mark.parametrize("world", WORLDS)
def test_experience_goes_up_as_it_is_and_says_whether_it_goes_on(world: str) -> None:
    settings = scenario(world, end=5, starts="entry")
    settings = settings.model_copy(update={"meta": settings.meta.model_copy(update={"starts": "entry"})})
    explorer = Explorer(settings, 1)
    motions = [each for round_ in (1, 2) for each in sent(settings, explorer.motions(round_))]
    assert [motion.header.motion for motion in motions] == [0, 1, 2, 0, 1, 2]
    if world in ("Known", "Looking"):  # five motions on, and a new episode's first
        assert [motion.header.action for motion in motions] == [GO] * 6
        assert [motion.header.reward for motion in motions] == [1, 2, 3, 4, 5, 1]
        assert [motion.header.first for motion in motions] == [True, False, False, False, False, True]
        assert [motion.header.terminated for motion in motions] == [False] * 4 + [True, False]
        assert [motion.frame[0] for motion in motions] == [0, 1, 2, 3, 4, 0]
    else:  # no guide: random actions; nothing to go on from: each round begins anew
        assert [motion.header.first for motion in motions] == [True, False, False] * 2
        assert {motion.header.action for r in range(1, 9) for motion in sent(settings, explorer.motions(r))} == {0, 1}


@pytest.mark.parametrize("world", WORLDS)
def test_a_round_is_the_same_to_the_bit_whenever_it_is_asked_for(world: str) -> None:
    settings = scenario(world, end=7)
    settings = settings.model_copy(update={"meta": settings.meta.model_copy(update={"epsilon": 0.5})})
    one, other, late = Explorer(settings, 1), Explorer(settings, 1), Explorer(settings, 1)
    rounds = {round_: list(one.motions(round_)) for round_ in range(1, 9)}
    assert {round_: list(other.motions(round_)) for round_ in (8, 1, 5, 2, 7, 3, 6, 4)} == rounds
    late.begin("fl", settings.cluster(1))
    late.collect(always(GO, settings), 5)
    assert list(late.motions(8)) == rounds[8]
    assert list(one.motions(2)) == rounds[2]  # long ago
    assert rounds[1] != rounds[2]


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("sends", [False, True], ids=["into its own memory", "to the data center"])
def test_an_explorer_that_comes_back_goes_on_bit_by_bit(sends: bool, world: str, tmp_path: Path) -> None:
    settings = scenario(world, end=5, epsilon=0.5)

    def next_round(explorer: Explorer, round_: int) -> tuple[Any, ...]:
        learner = always(GO, settings)
        if sends:
            return list(explorer.policy_motions(learner, round_)), explorer.evaluate(learner)
        explorer.collect(learner, 4)
        batch = learner.replay.sample(20, np.random.default_rng(1))
        return [part.tolist() for part in batch], explorer.evaluate(learner)

    undisturbed = begun(settings)
    next_round(undisturbed, 1)
    file = StateFile(tmp_path / "s.safetensors", "o")
    file.save(undisturbed.state())
    state, back = file.load(), begun(settings)
    assert state is not None
    back.load_state(state)
    for round_ in (2, 3, 4):
        assert next_round(back, round_) == next_round(undisturbed, round_)
        assert back.evaluation == undisturbed.evaluation


def test_pictures_are_kept_at_the_networks_size_and_sent_as_they_are() -> None:
    settings = scenario("Pictures")
    (motion, *_) = sent(settings, Explorer(settings, 1).motions(1))
    assert motion.frame.shape == (2, 3, 3)
    assert motion.payload_bytes > 4 * 6 * 3
    learner = always(GO, settings)
    begun(settings).collect(learner, 3)
    assert learner.replay.sample(1, np.random.default_rng(0)).frames.shape == (1, 2, 3, 3)


@pytest.mark.parametrize("world", WORLDS)
def test_by_the_guide_robots_move_as_it_says_and_where_there_is_none_by_their_own_policy(world: str) -> None:
    settings = scenario(world, end=100, starts="entry", collect="guide")
    robot = always(1 - GO, settings)
    begun(settings).collect(robot, 3)
    followed = GO if world in ("Known", "Looking") else 1 - GO
    assert set(robot.replay.sample(50, np.random.default_rng(0)).actions.tolist()) == {followed}
