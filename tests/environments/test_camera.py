"""The robots' cameras."""

import numpy as np
import pytest

from jouleswarm.codecs.frames import resize
from jouleswarm.common.scenario.reading import load_scenario, scenario_from
from jouleswarm.environments.landmarks.camera import Camera
from jouleswarm.environments.landmarks.settings import Camera as CameraSettings
from jouleswarm.environments.landmarks.settings import World, shared_obstacles
from jouleswarm.environments.landmarks.small import SmallCamera

STILL = CameraSettings(pose_jitter_m=0, heading_jitter_deg=0, noise=0)
HORIZON, MIDDLE, DEPTH = 240, 320, 3


def look(camera: Camera | SmallCamera, cell: tuple[int, int], seed: int = 0) -> np.ndarray:
    return camera.frame(cell, np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("row", "grey"),
    [  # the wall is one cell behind row 7: 8 - row metres ahead, 255 x distance / 5 m
        (7, 51),
        (6, 102),
        (5, 153),
        (4, 204),
        (3, 255),
        (0, 255),  # 8 m, out of range
    ],
)
def test_depth_of_the_wall_ahead(row: int, grey: int) -> None:
    assert look(Camera(World(), STILL), (row, 2))[HORIZON, MIDDLE, DEPTH] == grey


def test_depth_is_in_metres() -> None:
    assert look(Camera(World(cell_m=2.0), STILL), (6, 2))[HORIZON, MIDDLE, DEPTH] == 204  # 2 cells, 4 m


def test_depth_of_the_floor_at_the_lower_edge() -> None:
    # Drawn 320 x 240, 90 degrees across: focal length 160. The last row is 119.5 below the middle, the camera
    # 0.3 m above the floor: 0.3 x 160 / 119.5 = 0.4017 m -> 20.5 grey
    assert look(Camera(World(), STILL), (0, 2))[-1, MIDDLE, DEPTH] in (20, 21)


def test_depth_of_an_obstacle() -> None:
    # two cells ahead, a barrel of radius 0.3: 1.7 m -> 86.7 grey
    camera = Camera(World(), STILL, frozenset({(2, 0)}))
    assert look(camera, (0, 0))[HORIZON, MIDDLE, DEPTH] == 87


def test_an_obstacle_can_be_entered() -> None:
    camera = Camera(World(), STILL, frozenset({(7, 2)}))
    assert look(camera, (7, 2))[HORIZON, MIDDLE, DEPTH] == 51


def test_frames_are_full_size_rgbd() -> None:
    frame = look(Camera(World(), CameraSettings()), (0, 2))
    assert (frame.shape, frame.dtype, frame.nbytes) == ((480, 640, 4), np.uint8, 1_228_800)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (33, 21), (64, 48)])
def test_other_frame_sizes(width: int, height: int) -> None:
    assert look(Camera(World(), CameraSettings(width=width, height=height)), (3, 3)).shape == (height, width, 4)


def test_no_two_frames_at_a_landmark_are_the_same() -> None:
    camera, rng = Camera(World(), CameraSettings()), np.random.default_rng(0)
    frames = [camera.frame((2, 2), rng).tobytes() for _ in range(20)]
    assert len(set(frames)) == 20


def test_a_frame_depends_on_settings_landmark_and_generator_only() -> None:
    first, second = Camera(World(), CameraSettings()), Camera(World(), CameraSettings())
    for cell in ((0, 0), (7, 4), (1, 2)):
        look(second, cell)  # what was seen before must not matter
    np.testing.assert_array_equal(look(first, (1, 2), 5), look(second, (1, 2), 5))


def test_a_frame_is_the_callers_own() -> None:
    camera = Camera(World(), CameraSettings())
    before = look(camera, (1, 2)).copy()
    look(camera, (1, 2))[:] = 0
    np.testing.assert_array_equal(look(camera, (1, 2)), before)


def test_noise_has_the_deviation_asked_for() -> None:
    noisy = look(Camera(World(), STILL.model_copy(update={"noise": 5.0})), (7, 2)).astype(float)
    clean = look(Camera(World(), STILL), (7, 2)).astype(float)
    unclipped = (clean > 30) & (clean < 225)  # 6 deviations
    # 0.29 of rounding adds nothing to speak of; 10^5 samples put 3 standard errors at 0.7 %
    assert (noisy - clean)[unclipped].std() == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize("size", [(96, 72), (48, 36)])
def test_landmarks_can_be_told_apart(size: tuple[int, int]) -> None:
    """By their mean frame alone: position and heading jitter move near edges by at most one to two of 48 pixels,
    and noise averages out, so anything that a linear classifier gets wrong here is a look-alike. One look-alike
    pair among the 40 would cost 2 of 40 landmarks, about half of 5 %: expect all but 1 %."""
    camera, rng = Camera(World(), CameraSettings()), np.random.default_rng(1)
    cells = [(r, c) for r in range(8) for c in range(5)]
    frames = np.array([[resize(camera.frame(cell, rng), *size) for _ in range(10)] for cell in cells])
    frames = frames.reshape(40, 10, -1).astype(np.float32)
    means, unseen = frames[:, :5].mean(axis=1), frames[:, 5:].reshape(200, -1)
    squares = (means**2).sum(axis=1) - 2 * unseen @ means.T
    assert (squares.argmin(axis=1) == np.repeat(np.arange(40), 5)).mean() >= 0.99


def test_only_obstacles_of_all_tasks_are_in_the_world() -> None:
    maps = ("E#\n*.\nX#", "E#\n*#\nX.")
    tasks = [{"id": i, "map": text} for i, text in enumerate(maps, 1)]
    data = {"name": "x", "methods": ["fl"], "world": {"rows": 3, "cols": 2}, "tasks": tasks}
    assert shared_obstacles(scenario_from(data, "test")) == {(0, 1)}


@pytest.mark.parametrize(("row", "grey"), [(7, 51), (5, 153)])  # as above
@pytest.mark.parametrize("size", [(96, 72), (48, 36), (84, 84)])
def test_a_small_camera_sees_what_is_left_of_a_frame_when_it_is_shrunk(
    row: int, grey: int, size: tuple[int, int]
) -> None:
    width, height = size
    small = look(SmallCamera(World(), STILL, frozenset(), size), (row, 2))
    shrunk = resize(look(Camera(World(), STILL), (row, 2)), width, height)
    assert small.shape == shrunk.shape
    assert small[height // 2, width // 2, DEPTH] == grey
    # Both average, over other points of tiles and edges: no whole pixel apart on the whole, nor brighter or darker.
    apart = small.astype(float) - shrunk
    assert np.abs(apart).mean() < 2.0
    assert abs(apart.mean()) < 0.5


def test_a_small_camera_has_the_noise_that_averaging_leaves() -> None:
    # 100 x 100 pixels of deviation 50 become one: 50 / 100 = 0.5, and rounding to whole levels 0.5 -> 0.58
    still = STILL.model_copy(update={"width": 400, "height": 300})
    noisy = still.model_copy(update={"noise": 50.0})
    cameras = [SmallCamera(World(), each, frozenset(), (4, 3)) for each in (noisy, still)]
    of, clean = ([look(camera, (7, 2), seed).astype(float) for seed in range(200)] for camera in cameras)
    inside = (np.array(clean) > 3) & (np.array(clean) < 252)
    assert (np.array(of) - np.array(clean))[inside].std() == pytest.approx(0.58, abs=0.05)


def test_a_world_of_many_landmarks_is_not_drawn_ahead() -> None:
    few, many = (
        load_scenario("quick", [f"camera.width={width}", f"camera.height={height}"])
        for width, height in ((96, 72), (4096, 4096))
    )
    # 40 landmarks x 96 x 72 are 0.3 million pixels, 40 x 4096 x 4096 are 671 million.
    assert len(few.share()) == 2  # type: ignore[arg-type] -- as robots look, and as they send it
    assert many.share() == []
