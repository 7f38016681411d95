"""What a person sees of the landmark world: the map, the window, a video."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from gymnasium.wrappers import RecordVideo

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.environment import LandmarksEnv
from jouleswarm.environments.landmarks.maps import parse_map
from jouleswarm.environments.landmarks.view import LANDMARK, map_picture

FORWARD = 0
EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def small() -> Scenario:
    return load_scenario("paper", ["camera.width=64", "camera.height=48"])


def test_the_map_shows_entry_exit_obstacle_worth_path_and_walk() -> None:
    drawn = parse_map("E . .\n* . #\nX . .", 3, 3)
    rewards = np.array([[0, -1, -1], [0, -0.5, -80], [80, -1, -1]], np.float32)
    picture = map_picture(drawn, rewards, [(0, 0), (0, 1)])
    assert picture.shape == (3 * LANDMARK, 3 * LANDMARK, 3)
    corner, middle = LANDMARK // 8, LANDMARK // 2  # beside the lines' middle, off the grid's own lines

    def at(row: int, col: int, inside: int = corner) -> tuple[int, ...]:
        return tuple(picture[row * LANDMARK + inside, col * LANDMARK + inside].tolist())

    assert at(0, 0) == (86, 180, 233)  # entry
    assert at(2, 0) == (0, 158, 115)  # exit
    assert at(1, 2) == (40, 40, 40)  # obstacle
    assert at(1, 0) == (236, 236, 236)  # 0, the most that a plain landmark is worth: factor 1
    assert at(2, 1) == (165, 165, 165)  # -1, the least: 0.7 * 236 = 165.2
    assert at(1, 1) == (200, 200, 200)  # -0.5: 0.85 * 236 = 200.6
    assert at(1, 0, middle) == (120, 120, 120)  # the path runs through
    assert at(0, 1, middle) == (213, 94, 0)  # the robot stands here
    assert tuple(picture[middle, LANDMARK].tolist()) == (0, 114, 178)  # and came from the left


def test_render_modes_give_the_camera_the_map_or_both_in_a_window(
    small: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    shapes = {}
    for mode in ("rgb_array", "map"):
        env = LandmarksEnv(scenario=small, task=2, render_mode=mode)
        env.reset(seed=0)
        shapes[mode] = env.render().shape  # type: ignore[union-attr]
    assert shapes == {"rgb_array": (48, 64, 3), "map": (8 * LANDMARK, 5 * LANDMARK, 3)}

    env = LandmarksEnv(scenario=small, task=2, render_mode="human")
    env.reset(seed=0)
    assert env.render() is None
    import pygame

    # the camera's 64 x 48 at the map's height, 384: 512 beside 240
    assert pygame.display.get_surface().get_size() == (512 + 240, 384)
    env.close()
    assert not pygame.display.get_init()


def test_without_pygame_a_window_is_refused_and_told_how_to_get(
    small: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match=r'pip install "jouleswarm\[render\]"'):
        LandmarksEnv(scenario=small, render_mode="human")


def test_record_video_leaves_an_mp4_of_an_episode(small: Scenario, tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = RecordVideo(LandmarksEnv(scenario=small, task=2, render_mode="map"), str(tmp_path), lambda _: True)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.int64(FORWARD))
    env.close()
    (video,) = tmp_path.glob("*.mp4")
    assert video.read_bytes()[4:8] == b"ftyp"


def test_stable_baselines_learns_by_the_example(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    done = subprocess.run(
        [sys.executable, EXAMPLES / "sb3.py", "--motions", "110", "--episodes", "1", "--video", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=240,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("task 1: return ")
    assert list(tmp_path.glob("*.mp4"))
