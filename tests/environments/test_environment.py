"""The Gymnasium environment."""

import re
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.environment import LandmarksEnv
from jouleswarm.environments.landmarks.settings import task_map

FORWARD, BACKWARD, LEFT, RIGHT = range(4)
PAPER = Path(__file__).parents[2] / "scenarios" / "paper.toml"


@pytest.fixture(scope="module")
def small() -> Scenario:
    return load_scenario(PAPER, ["camera.width=64", "camera.height=48"])


def test_importing_environments_registers_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)  # the default scenario is found from anywhere
    env = gymnasium.make("jouleswarm/Landmarks-v0", task=2)
    frame, info = env.reset(seed=1)
    assert frame.shape == (480, 640, 4)
    assert info == {"cell": (0, 2), "position_m": (0.0, 2.0), "reached_exit": False}
    assert isinstance(env.unwrapped, LandmarksEnv)
    assert env.unwrapped.task_map.exit == (7, 1)


def test_gymnasium_finds_nothing_wrong() -> None:
    env = gymnasium.make("jouleswarm/Landmarks-v0", task=1, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_scenario_may_be_a_file_or_an_object(small: Scenario) -> None:
    assert LandmarksEnv(scenario=small, task=3).observation_space.shape == (48, 64, 4)
    assert LandmarksEnv(scenario=str(PAPER)).task_map == task_map(small, 1)


def test_a_walk_down_the_path_terminates_at_the_exit(small: Scenario) -> None:
    env = LandmarksEnv(scenario=small, task=2)
    env.reset(seed=0)
    steps = [env.step(action) for action in (*[FORWARD] * 5, LEFT, FORWARD, FORWARD)]
    # L = 8: -0.5 - 3.5 (1 - i/8) on arrival at i = 1..7, then the exit
    assert [reward for _, reward, *_ in steps] == [-3.5625, -3.125, -2.6875, -2.25, -1.8125, -1.375, -0.9375, 80]
    assert [(terminated, truncated) for _, _, terminated, truncated, _ in steps] == [(False, False)] * 7 + [
        (True, False)
    ]
    assert steps[-1][4] == {"cell": (7, 1), "position_m": (7.0, 1.0), "reached_exit": True}


def test_an_episode_is_truncated_after_20_motions(small: Scenario) -> None:
    env = LandmarksEnv(scenario=small, task=2)
    for _ in range(2):  # the count starts anew
        env.reset(seed=0)
        ends = [env.step(BACKWARD)[1:4] for _ in range(20)]
        assert ends == [(-4.0, False, False)] * 19 + [(-4.0, False, True)]


def test_the_exit_reached_by_the_last_motion_is_no_truncation() -> None:
    env = LandmarksEnv(scenario=load_scenario(PAPER, ["world.max_motions=7", "camera.width=8"]), task=3)
    env.reset(seed=0)
    ends = [env.step(FORWARD)[2:4] for _ in range(7)]
    assert ends[-1] == (True, False)


def test_the_robot_stays_at_the_edge(small: Scenario) -> None:
    env = LandmarksEnv(scenario=small, task=1)
    env.reset(seed=0, options={"start": (3, 4)})
    assert env.step(RIGHT)[4]["cell"] == (3, 4)


def test_random_starts_are_anywhere_but_the_exit(small: Scenario) -> None:
    env = LandmarksEnv(scenario=small, task=3)
    env.reset(seed=0)
    cells = {env.reset(options={"start": "random"})[1]["cell"] for _ in range(600)}
    # 39 landmarks; the chance to miss a given one in 600 draws is (38/39)^600 < 2e-7
    assert cells == {(r, c) for r in range(8) for c in range(5)} - {(7, 2)}


@pytest.mark.parametrize("start", [[3, 4], (np.int64(3), np.uint8(4)), np.array([3, 4])])
def test_a_start_may_be_of_numpy_s_integers(small: Scenario, start: object) -> None:
    _, info = LandmarksEnv(scenario=small, task=3).reset(seed=0, options={"start": start})
    assert info["cell"] == (3, 4)
    assert [type(each) for each in info["cell"]] == [int, int]


@pytest.mark.parametrize(
    "start",
    [
        (8, 0),
        (-1, 2),
        (7, 2),
        "exit",
        3,
        (1, 2, 3),
        None,
        (True, 1),
        (1.0, 2),
        np.array([1.0, 2.0]),
        np.array([[1, 2]]),
    ],
)
def test_a_start_off_the_grid_is_refused(small: Scenario, start: object) -> None:
    with pytest.raises(ConfigurationError, match="start"):
        LandmarksEnv(scenario=small, task=3).reset(options={"start": start})


@pytest.mark.parametrize("action", [-1, 4, 7, 1.9, 1.0, "0", None, True, np.bool_(True), np.array([1]), np.float32(1)])
def test_an_action_that_is_none_is_refused_and_nothing_moves(small: Scenario, action: Any) -> None:
    env = LandmarksEnv(scenario=small, task=1)
    env.reset(seed=0)
    with pytest.raises(InvalidAction, match=re.escape(f"action {action!r}, expected one of the integers 0 to 3")):
        env.step(action)
    assert env.step(FORWARD)[4]["cell"] == (1, 2)


@pytest.mark.parametrize("action", [RIGHT, np.int64(RIGHT), np.uint8(RIGHT), np.array(RIGHT)])
def test_an_action_may_be_any_integer_of_python_or_numpy(small: Scenario, action: Any) -> None:
    env = LandmarksEnv(scenario=small, task=1)
    env.reset(seed=0)
    assert env.step(action)[4]["cell"] == (0, 3)


def test_a_motion_outside_of_an_episode_is_refused(small: Scenario) -> None:
    env = LandmarksEnv(scenario=small, task=3)
    with pytest.raises(ResetNeeded, match=r"none was begun; expected reset\(\) before step\(\)"):
        env.step(FORWARD)
    env.reset(seed=0, options={"start": (6, 2)})
    assert env.step(FORWARD)[2]  # the exit
    with pytest.raises(ResetNeeded, match="it has ended"):
        env.step(FORWARD)
    env.reset()
    for _ in range(20):
        *_, truncated, _ = env.step(BACKWARD)
    assert truncated
    with pytest.raises(ResetNeeded, match="it has ended"):
        env.step(FORWARD)


def test_an_option_that_is_not_known_is_refused(small: Scenario) -> None:
    env = LandmarksEnv(scenario=small, task=3)
    with pytest.raises(
        ConfigurationError, match=r"reset options \['begin'\] are not known, expected \"start\" or none"
    ):
        env.reset(options={"begin": (1, 1)})


def test_same_seed_same_episode(small: Scenario) -> None:
    def episode(seed: int) -> list[bytes]:
        env = LandmarksEnv(scenario=small, task=2)
        frames = [env.reset(seed=seed, options={"start": "random"})[0]]
        frames += [env.step(action)[0] for action in (FORWARD, LEFT, FORWARD)]
        return [frame.tobytes() for frame in frames]

    assert episode(4) == episode(4)
    assert episode(4) != episode(5)


def test_tasks_look_the_same(small: Scenario) -> None:
    frames = [LandmarksEnv(scenario=small, task=task).reset(seed=3)[0] for task in (1, 5)]
    np.testing.assert_array_equal(*frames)


def test_a_shared_camera_changes_nothing(small: Scenario) -> None:
    alone = LandmarksEnv(scenario=small, task=1)
    shared = LandmarksEnv(scenario=small, task=1, camera=LandmarksEnv(scenario=small, task=2).camera)
    np.testing.assert_array_equal(alone.reset(seed=3)[0], shared.reset(seed=3)[0])


def test_render_shows_the_newest_frame(small: Scenario) -> None:
    env = LandmarksEnv(scenario=small, render_mode="rgb_array")
    frame, _ = env.reset(seed=0)
    picture = env.render()
    assert picture is not None
    np.testing.assert_array_equal(picture, frame[..., :3])
    assert LandmarksEnv(scenario=small).render() is None


def test_an_unknown_task_is_refused(small: Scenario) -> None:
    with pytest.raises(ConfigurationError, match=r"task 7 is not in scenario paper, expected one of \[1, 2, 3"):
        LandmarksEnv(scenario=small, task=7)


def test_a_missing_scenario_is_explained(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"nowhere\.toml: cannot be read"):
        LandmarksEnv(scenario=tmp_path / "nowhere.toml")
