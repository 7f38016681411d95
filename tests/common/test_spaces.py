"""Sizes that follow from what an environment shows and takes, worked out by hand."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

from jouleswarm.codecs.observations import experience_bytes
from jouleswarm.codecs.png import Png
from jouleswarm.codecs.raw import Raw
from jouleswarm.codecs.resized import Resized
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.environments import spaces_of
from jouleswarm.common.scenario.reading import scenario_from, with_overrides
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Network
from jouleswarm.common.scenario.spaces import Interface, Observation, Spaces, shipped_tensors
from tests.worlds import Maze

VECTOR = Observation(shape=(4,), dtype="float32")
NUMBER = Observation(shape=(), dtype="int64", values=16)
PICTURE = Observation(shape=(48, 64, 3), dtype="uint8")
SMALL = Network(width=16, height=12, conv=((8, 4, 2),), dense=(5,))


@pytest.mark.parametrize(
    ("observation", "nbytes", "fed", "kept"),
    [
        (VECTOR, 16, (4,), (4,)),
        (NUMBER, 8, (16,), ()),
        (PICTURE, 48 * 64 * 3, (3, 48, 64), (12, 16, 3)),
        (Observation(shape=(), dtype="float64"), 8, (1,), ()),
        (Observation(shape=(3, 5, 7), dtype="float32"), 420, (3, 5, 7), (3, 5, 7)),
    ],
)
def test_what_is_seen_has_its_bytes_and_reaches_the_network(
    observation: Observation, nbytes: int, fed: tuple[int, ...], kept: tuple[int, ...]
) -> None:
    assert (observation.nbytes, observation.fed, observation.kept(SMALL).shape) == (nbytes, fed, kept)


def test_pictures_are_as_they_are_where_no_size_is_asked_for() -> None:
    assert PICTURE.kept(Network()) == PICTURE
    assert PICTURE.kept(Network(height=10)).shape == (10, 64, 3)


def test_bytes_on_the_uplink() -> None:
    codecs = (Raw("uint8"), Png(), Resized(PICTURE.kept(SMALL)))
    assert [experience_bytes(codec, PICTURE) for codec in codecs] == [9216, None, 16 * 12 * 3]
    assert experience_bytes(Raw("int64"), NUMBER) == 8


@pytest.mark.parametrize(
    ("observation", "network", "tensors"),
    [
        (VECTOR, SMALL, [("1.weight", (5, 4)), ("1.bias", (5,)), ("3.weight", (2, 5)), ("3.bias", (2,))]),
        (NUMBER, Network(dense=()), [("1.weight", (2, 16)), ("1.bias", (2,))]),
        (  # 12 x 16 -> (12 - 4) // 2 + 1 = 5 by (16 - 4) // 2 + 1 = 7, of 8 channels: 280
            PICTURE,
            SMALL,
            [
                ("0.weight", (8, 3, 4, 4)), ("0.bias", (8,)),
                ("3.weight", (5, 280)), ("3.bias", (5,)), ("5.weight", (2, 5)), ("5.bias", (2,)),
            ],
        ),
        (PICTURE, Network(build="mlp", dense=()), [("1.weight", (2, 9216)), ("1.bias", (2,))]),
    ],
)  # fmt: skip
def test_tensors_of_the_networks_that_ship_here(
    observation: Observation, network: Network, tensors: list[tuple[str, tuple[int, ...]]]
) -> None:
    found = shipped_tensors(network, Spaces(observation=observation, actions=("a", "b")))
    assert found is not None
    assert list(found.tensors) == tensors
    assert found.head == 2


@pytest.mark.parametrize(("build", "observation"), [("my:own", VECTOR), ("deepmind", VECTOR)])
def test_other_networks_are_not_counted(build: str, observation: Observation) -> None:
    assert shipped_tensors(Network(build=build), Spaces(observation=observation, actions=("a",))) is None


@pytest.mark.parametrize(
    ("array", "told"),
    [
        (np.zeros(4, np.float32), ""),
        (np.zeros(3, np.float32), "of shape [3]"),
        (np.array([0, np.nan, 0, 0], np.float32), "that is not finite"),
    ],
)
def test_what_cannot_have_been_seen_is_told(array: Any, told: str) -> None:
    assert VECTOR.misfit(array) == told


def test_numbers_of_another_space_are_told() -> None:
    found = [NUMBER.misfit(np.array(value)) for value in (-1, 0, 15, 16)]
    assert found == ["of -1", "", "", "of 16"]


class Shown(gymnasium.Env[Any, Any]):
    def __init__(self, seen: Any, done: Any, metadata: dict[str, Any] | None = None) -> None:
        self.observation_space, self.action_space, self.metadata = seen, done, metadata or {}


BOX, TWO = gymnasium.spaces.Box(0, 1, (2,), np.float32), gymnasium.spaces.Discrete(2)


def test_actions_and_channels_have_the_names_that_the_environment_gives() -> None:
    told = spaces_of(Shown(BOX, TWO, {"actions": ["stay", "go"], "channels": ["a", "b"]}), "x")
    assert (told.actions, told.channels) == (("stay", "go"), ("a", "b"))
    assert spaces_of(Shown(BOX, TWO), "x").actions == ("0", "1")


@pytest.mark.parametrize(
    ("seen", "done", "metadata", "message"),
    [
        (BOX, gymnasium.spaces.Box(0, 1), {}, "x: continuous actions"),
        (BOX, gymnasium.spaces.MultiDiscrete([2, 2]), {}, "x: action space MultiDiscrete"),
        (BOX, gymnasium.spaces.Discrete(10_001), {}, "x: 10001 actions, expected 10000 at most"),
        (BOX, TWO, {"actions": ["a"]}, r'metadata\["actions"\] names 1, expected 2'),
        (gymnasium.spaces.Text(3), TWO, {}, "x: observation space .*expected Box or Discrete"),
        (gymnasium.spaces.Box(0, 1, (2,), np.longdouble), TWO, {}, "x: observations of float128"),
    ],
)
def test_spaces_that_nobody_learns_values_of_are_told(seen: Any, done: Any, metadata: Any, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        spaces_of(Shown(seen, done, metadata), "x")


def with_maze(**data: Any) -> Scenario:
    base = {"name": "t", "methods": ["fl"], "environment": "tests.worlds:maze", "tasks": [{"id": 1}]}
    return scenario_from({**base, **data}, "test")


def test_an_environments_own_table_is_checked_handed_in_and_kept() -> None:
    scenario = with_maze(maze={"walls": 5}, tasks=[{"id": 1, "kwargs": {"walls": 2}}])
    assert scenario.own("maze", Maze) == Maze(walls=5)
    assert scenario.spaces.observation.shape == (7,)
    assert scenario_from(scenario.model_dump(mode="json"), "test") == scenario
    assert with_overrides(scenario, ["maze.walls=6"], "x").spaces.observation.shape == (8,)
    with pytest.raises(ConfigurationError, match=r"maze.walls: .*valid integer"):
        with_maze(maze={"walls": "many"})


def test_an_environments_defaults_stand_where_the_scenario_says_nothing() -> None:
    learning = with_maze(learning={"lr": 0.125}).learning
    assert (learning.epsilon, learning.lr) == (0.5, 0.125)


def test_sizes_that_are_known_are_those_of_the_same_settings_only() -> None:
    scenario = with_maze()
    told = Interface(
        spaces=Spaces(observation=Observation(shape=(9,), dtype="float32"), actions=("a",)), tensors=(), head=0
    )
    scenario.remember(told)
    assert scenario.interface == told
    assert scenario.spaces == told.spaces
    assert with_overrides(scenario, ["energy.pue=2"], "x").interface == told
    assert with_overrides(scenario, ["maze.walls=4"], "x").interface is None
