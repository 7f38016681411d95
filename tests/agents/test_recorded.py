"""Landmarks as a user's own pictures show them."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.environments.landmarks.environment import LandmarksEnv
from jouleswarm.environments.landmarks.pictures import missing, pictures
from jouleswarm.environments.landmarks.recorded import RecordedCamera, read_frame
from jouleswarm.environments.landmarks.settings import Camera

EXAMPLES = Path(__file__).parents[2] / "examples"
SETTINGS = Camera(width=4, height=2, range_m=5.0)
RED = (0, 0, 255)  # as OpenCV has it: blue, green, red


def recorded(folder: Path, name: str, colour: tuple[int, int, int] = RED, metres: float = 1.0) -> Path:
    """A picture of 8 x 4 in one colour, at one distance."""
    folder.mkdir(parents=True, exist_ok=True)
    picture = folder / f"{name}.png"
    cv2.imwrite(str(picture), np.full((4, 8, 3), colour, np.uint8))
    cv2.imwrite(str(folder / f"{name}.depth.png"), np.full((4, 8), 1000 * metres, np.uint16))
    return picture


def test_a_frame_has_red_green_blue_and_the_distance_of_the_range(tmp_path: Path) -> None:
    frame = read_frame(recorded(tmp_path, "a"), SETTINGS)
    assert (frame.shape, frame.dtype) == ((2, 4, 4), np.uint8)
    assert frame.reshape(-1, 4).tolist() == [[255, 0, 0, 51]] * 8  # 255 x 1 m / 5 m


@pytest.mark.parametrize(("metres", "grey"), [(4.0, 204), (5.0, 255), (60.0, 255), (0.0, 255)])
def test_what_is_out_of_range_or_was_not_measured_is_the_furthest(tmp_path: Path, metres: float, grey: int) -> None:
    assert read_frame(recorded(tmp_path, "a", metres=metres), SETTINGS)[0, 0, 3] == grey


def test_distances_may_be_metres_in_an_npz(tmp_path: Path) -> None:
    picture = recorded(tmp_path, "a")
    (tmp_path / "a.depth.png").unlink()
    np.savez(tmp_path / "a.npz", depth=np.array([[2.0, np.nan], [2.0, np.inf]]))
    assert read_frame(picture, Camera(width=2, height=2))[..., 3].tolist() == [[102, 255], [102, 255]]


def test_each_picture_of_a_landmark_is_seen_and_the_same_draw_sees_the_same(tmp_path: Path) -> None:
    for value in (10, 20, 30):
        recorded(tmp_path / "1-2", f"p{value}", (value, value, value))
    camera = RecordedCamera(SETTINGS, tmp_path)
    rng = np.random.default_rng(1)
    seen = [int(camera.frame((1, 2), rng)[0, 0, 0]) for _ in range(30)]
    assert set(seen) == {10, 20, 30}
    rng = np.random.default_rng(1)
    assert [int(RecordedCamera(SETTINGS, tmp_path).frame((1, 2), rng)[0, 0, 0]) for _ in range(30)] == seen


def test_a_frame_is_an_array_of_its_own(tmp_path: Path) -> None:
    recorded(tmp_path / "0-0", "a")
    camera = RecordedCamera(SETTINGS, tmp_path)
    camera.frame((0, 0), np.random.default_rng(1))[:] = 0
    assert camera.frame((0, 0), np.random.default_rng(1))[0, 0, 0] == 255


def test_landmarks_without_a_picture_are_all_named_in_one_line(tmp_path: Path) -> None:
    recorded(tmp_path / "0-0", "a")
    (tmp_path / "1-1").mkdir()
    (line,) = missing(tmp_path, 2, 2)
    assert f"{tmp_path}: no picture of landmarks 0-1, 1-0, 1-1; expected ROW-COL/NAME.png" in line
    assert next(missing(tmp_path / "nowhere", 2, 2)).endswith("nowhere: no such folder")


def test_pictures_without_their_depth_are_all_named(tmp_path: Path) -> None:
    for name in ("a", "b"):
        recorded(tmp_path / "0-0", name)
        (tmp_path / "0-0" / f"{name}.depth.png").unlink()
    (line,) = missing(tmp_path, 1, 1)
    assert "no depth of 0-0/a.png, 0-0/b.png; expected NAME.depth.png" in line
    assert [path.name for path in pictures(tmp_path, (0, 0))] == ["a.png", "b.png"]


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("a.png", b"GIF", "a.png is no picture"),
        ("a.depth.png", b"GIF", "a.depth.png is no PNG, expected 16 bit, millimetres"),
        ("a.npz", b"PK", "a.npz: .*expected an array named depth"),
    ],
)
def test_a_file_that_is_none_is_named(tmp_path: Path, file: str, content: bytes, message: str) -> None:
    picture = recorded(tmp_path, "a")
    if file.endswith("npz"):
        (tmp_path / "a.depth.png").unlink()
    (tmp_path / file).write_bytes(content)
    with pytest.raises(ConfigurationError, match=message):
        read_frame(picture, SETTINGS)


def test_eight_bits_of_distance_are_refused(tmp_path: Path) -> None:
    picture = recorded(tmp_path, "a")
    cv2.imwrite(str(tmp_path / "a.depth.png"), np.zeros((4, 8), np.uint8))
    with pytest.raises(ConfigurationError, match=r"a\.depth\.png is uint8, expected 16 bit"):
        read_frame(picture, SETTINGS)


def test_a_scenario_looks_beside_its_file_and_knows_the_pictures_by_what_is_in_them(tmp_path: Path) -> None:
    text = (EXAMPLES / "recorded.toml").read_text().replace("rows = 4\ncols = 3", "rows = 2\ncols = 1")
    (tmp_path / "s.toml").write_text(
        text.split("[[tasks]]")[0] + "[[tasks]]\nid = 1\nmap = 'E\nX'\n".replace("'", "'''")
    )
    with pytest.raises(ConfigurationError, match=r"s\.toml: camera\.frames .*frames: no such folder"):
        load_scenario(tmp_path / "s.toml")
    for cell in ("0-0", "1-0"):
        recorded(tmp_path / "frames" / cell, "a")
    before = load_scenario(tmp_path / "s.toml")
    was, (frame, _) = before.determines, LandmarksEnv(scenario=before).reset(seed=1)
    assert frame[0, 0].tolist() == [255, 0, 0, 51]
    recorded(tmp_path / "frames" / "1-0", "a", metres=2.0)
    assert load_scenario(tmp_path / "s.toml").determines != was


def test_the_example_s_pictures_are_what_its_script_makes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["record", str(tmp_path), "--width", "48", "--height", "36"])
    runpy.run_path(str(EXAMPLES / "record_frames.py"), run_name="__main__")
    files = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.png"))
    assert files == sorted(path.relative_to(EXAMPLES / "frames") for path in (EXAMPLES / "frames").rglob("*.png"))
    assert len(files) == 4 * 3 * 2 * 2
    for file in files:
        ours, theirs = (cv2.imread(str(at / file), cv2.IMREAD_UNCHANGED) for at in (tmp_path, EXAMPLES / "frames"))
        assert np.median(np.abs(ours.astype(int) - theirs.astype(int))) <= 1, file


def test_the_example_s_wall_is_as_far_away_as_it_is() -> None:
    env = LandmarksEnv(task=2, scenario=EXAMPLES / "recorded.toml")
    frame, _ = env.reset(seed=1, options={"start": (3, 1)})
    assert abs(int(frame[18, 24, 3]) - 51) <= 2  # 1 m, of 5, give or take 0.03 m


def test_pictures_are_shrunk_once_where_robots_see_them_small() -> None:
    env = LandmarksEnv(task=2, scenario=load_scenario(EXAMPLES / "recorded.toml", ["camera.draw=input"]))
    assert env.show_as((18, 24, 4))
    frame, _ = env.reset(seed=1, options={"start": (3, 1)})
    assert frame.shape == (18, 24, 4)
    assert abs(int(frame[9, 12, 3]) - 51) <= 2  # the same wall
    assert env.show_as(None)
    assert env.look()[0].shape == env.observation_space.shape


def test_frames_stay_as_they_are_where_the_scenario_says_so() -> None:
    env = LandmarksEnv(task=2, scenario=load_scenario(EXAMPLES / "recorded.toml", ["camera.draw=frame"]))
    assert not env.show_as((18, 24, 4))
    assert env.reset(seed=1)[0].shape == env.observation_space.shape
