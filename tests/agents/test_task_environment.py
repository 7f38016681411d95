"""The environment door: what is asked of an environment, and what is made up for one that does not offer it."""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
import pytest

from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.environment import TaskEnvironment


def scenario(environment: str, *kwargs: dict[str, Any], **sections: Any) -> Scenario:
    tasks = [{"id": number, "kwargs": each} for number, each in enumerate(kwargs or ({},), start=1)]
    return scenario_from(
        {"name": "t", "methods": ["fl"], "environment": environment, "tasks": tasks, **sections}, "test"
    )


def made(name: str, **kwargs: Any) -> TaskEnvironment:
    return TaskEnvironment(scenario(f"tests.worlds:{name}", kwargs), 1)


def test_an_observation_is_an_array_of_its_own() -> None:
    environment = made("Line")
    first = environment.reset(seed=1)
    environment.step(1)
    assert (first[0], first.dtype) == (0.0, np.float32)


def test_a_step_is_as_gymnasium_has_it() -> None:
    environment = made("Line", end=2)
    environment.reset(seed=1)
    one, two = environment.step(1), environment.step(1)
    assert (one.reward, one.terminated, one.truncated, one.ended) == (1.0, False, False, False)
    assert (two.reward, two.terminated, two.ended) == (2.0, True, True)


def test_numbers_and_actions_are_counted_from_0() -> None:
    environment = made("Numbers", end=2)
    assert int(environment.reset()) == 0
    assert int(environment.step(1).observation) == 1
    assert int(environment.step(0).observation) == 1
    assert str(environment.spaces.observation) == "Discrete(15)"


def test_an_episode_without_an_end_is_cut() -> None:
    settings = scenario("tests.worlds:Line", learning={"max_episode_steps": 3})
    environment = TaskEnvironment(settings, 1)
    environment.reset()
    assert [environment.step(0).truncated for _ in range(3)] == [False, False, True]
    environment.reset()
    assert not environment.step(0).truncated


def test_what_is_not_offered_is_made_up_for() -> None:
    environment = made("Line")
    assert (environment.can_go_on, environment.can_look, environment.has_guide) == (False, False, False)
    assert environment.starts("area", 0, 2) == [{}]
    assert environment.judge(3.5) == (3.5, {})
    assert environment.spaces.actions == ("0", "1")


def test_what_is_offered_is_asked_for() -> None:
    environment = made("Known")
    environment.reset(options={"at": 2})
    assert (environment.can_go_on, environment.can_look, environment.has_guide) == (True, False, True)
    assert environment.guide() == 1
    assert (environment.starts("area", 0, 2), environment.starts("entry", 0, 2)) == ([{"at": 1}], [{"at": 0}])
    assert environment.judge(3.5) == (7.0, {"place": 2.0})


def test_plain_data_of_that_name_is_not_asked() -> None:
    assert not TaskEnvironment(scenario("CartPole-v1"), 1).can_go_on  # its `state` is an array


def test_it_goes_on_from_a_place_with_the_noise_that_it_had() -> None:
    ours, theirs = made("Known", end=100), made("Known", end=100)
    ours.reset(seed=1)
    ours.step(1)
    theirs.reset(seed=2)
    theirs.load_place(ours.place())
    theirs.load_noise(ours.noise())
    assert ours.step(1).observation.tolist() == theirs.step(1).observation.tolist()
    assert ours.place() == {"own": {"at": 2}, "steps": 2}


def test_a_time_limit_goes_on_too() -> None:
    gymnasium.register("jouleswarm-test/Known-v0", entry_point="tests.worlds:Known", max_episode_steps=3)
    settings = scenario("jouleswarm-test/Known-v0", {"end": 100})
    ours, theirs = TaskEnvironment(settings, 1), TaskEnvironment(settings, 1)
    ours.reset(seed=1)
    ours.step(1)
    ours.step(1)
    theirs.reset(seed=1)
    theirs.load_place(ours.place())
    assert theirs.step(1).truncated


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"reward": math.nan}, "a reward of nan, expected a number within 1e"),
        ({"reward": 1e12}, "a reward of 1000000000000.0"),
        ({"observation": [0, 0]}, r"an observation of shape \[2\]; expected float32 \[3\]"),
        ({"observation": [0, math.inf, 0]}, "an observation that is not finite"),
        ({"observation": ["a", "b", "c"]}, "an observation that is no float32"),
        ({"error": "out of\nbattery"}, r"step: ValueError: out of \(.*worlds.py, line \d+\)$"),
    ],
)
def test_what_goes_wrong_in_it_is_one_line(kwargs: dict[str, Any], message: str) -> None:
    environment = made("Odd", **kwargs)
    environment.reset()
    with pytest.raises(RunError, match=message) as caught:
        environment.step(0)
    assert str(caught.value).startswith("environment 'tests.worlds:Odd', task 1: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("word", "answer", "message"),
    [
        ("reset", np.zeros(3, np.float32), r"reset\(\) gave a ndarray, expected 2 values"),
        ("step", (np.zeros(3, np.float32), 0.0, False, {}), r"step\(\) gave 4 values, expected 5 values"),
        ("step", (np.zeros(3, np.float32), None, False, False, {}), "reward: TypeError"),
        ("guide", None, "guide: TypeError"),
        ("judge", 3.5, r"judge\(\) gave a float, expected 2 values"),
        ("judge", (3.5, None), "judge: AttributeError"),
        ("start", "entry", r"start\(\) gave 'entry', expected options of reset, or a list of them"),
        ("start", [], r"start\(\) gave \[\], expected"),
    ],
)
def test_an_answer_of_another_form_is_one_line(
    word: str, answer: object, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"tests.worlds.Known.{word}", lambda *_, **__: answer)
    environment = made("Known")
    asked = {"step": (0,), "judge": (1.0,), "starts": ("area", 0, 1)}
    name = "starts" if word == "start" else word
    with pytest.raises(RunError, match=message):
        getattr(environment, name)(*asked.get(name, ()))


def test_no_options_may_be_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.worlds.Known.start", lambda *_: None)
    assert made("Known").starts("area", 0, 2) == [{}]


@pytest.mark.parametrize(
    ("environment", "kwargs", "message"),
    [
        ("tests.worlds:Continuous", [{}], "continuous actions, .*expected Discrete"),
        ("tests.worlds:Half", [{}], r"has one of state\(\) and load_state\(\), expected both or none"),
        ("tests.worlds:refuses", [{}], "task 1: OSError: no simulator here$"),
        ("tests.worlds:nothing", [{}], "task 1: got a NoneType, expected a gymnasium.Env"),
        ("tests.worlds:BUFFER", [{}], "got a ndarray, expected a factory to call"),
        ("tests.worlds:Lime", [{}], "has no Lime; did you mean Line"),
        ("tests.nowhere:Line", [{}], "no module|cannot be imported"),
        ("tests.worlds:Line", [{"ende": 3}], r"unexpected keyword argument 'ende' \(kwargs: ende\)"),
        (
            "CartPol-v1",
            [{}],
            r"expected cartpole, landmarks, minigrid, module:factory or a Gymnasium id; did you mean ",
        ),
        ("landmark", [{}], "did you mean landmarks"),
        ("cartpole", [{"length": -1}], "cartpole: length -1"),
        ("Blackjack-v1", [{}], "observation space Tuple.*expected Box or Discrete: wrap it"),
    ],
)
def test_what_cannot_be_learned_in_is_told_in_one_line(
    environment: str, kwargs: list[dict[str, Any]], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message) as caught:
        TaskEnvironment(scenario(environment, *kwargs), 1)
    assert "\n" not in str(caught.value)


def test_tasks_with_other_spaces_are_told() -> None:
    settings = scenario("FrozenLake-v1", {"map_name": "4x4"}, {"map_name": "8x8"})
    TaskEnvironment(settings, 1)
    with pytest.raises(ConfigurationError, match=r"task 2: .*Discrete\(64\).*expected .*Discrete\(16\).*of task 1"):
        TaskEnvironment(settings, 2)


def test_a_table_of_somebody_elses_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="world: no such field"):
        scenario("tests.worlds:Line", world={"rows": 3})
    with pytest.raises(ConfigurationError, match=r"tasks\.0\.map: no such field"):
        scenario_from({"name": "t", "environment": "CartPole-v1", "tasks": [{"id": 1, "map": "EX"}]}, "test")
