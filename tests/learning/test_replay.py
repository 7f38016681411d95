"""Replay memory: which frames make transitions, and which are forgotten."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.errors import TrainingError
from jouleswarm.learning.replay import Replay
from tests.made_up import image

DRAWS = 400  # enough that each of a handful of transitions is drawn


def frame(number: int) -> npt.NDArray[np.uint8]:
    return np.full((1, 1, 4), number, np.uint8)


def transitions(replay: Replay, newest: int | None = None) -> set[tuple[int, int, float, int | None]]:
    """Everything that can be drawn, as (frame, action, reward, next frame or None)."""
    batch = replay.sample(DRAWS, np.random.default_rng(0), newest)
    return {
        (int(x[0, 0, 0]), int(y), float(r), None if done else int(after[0, 0, 0]))
        for x, y, r, after, done in zip(*batch, strict=True)
    }


def test_a_transition_is_whole_once_its_next_frame_is_there() -> None:
    replay = Replay(8, image(1, 1))
    replay.observe(frame(1), first=True)
    assert len(replay) == 0
    replay.act(2, 0.5, terminated=False)
    assert len(replay) == 0
    replay.observe(frame(2), first=False)
    assert len(replay) == 1
    assert transitions(replay) == {(1, 2, 0.5, 2)}


def test_a_terminated_transition_needs_no_next_frame() -> None:
    replay = Replay(8, image(1, 1))
    replay.observe(frame(1), first=True)
    replay.act(3, 80.0, terminated=True)
    assert transitions(replay) == {(1, 3, 80.0, None)}


def test_no_transition_leads_from_a_truncated_episode_into_the_next() -> None:
    replay = Replay(8, image(1, 1))
    replay.observe(frame(1), first=True)
    replay.act(0, 1.0, terminated=False)
    replay.observe(frame(2), first=False)  # truncated here: frame 2 has no action
    replay.observe(frame(3), first=True)
    replay.act(1, 2.0, terminated=False)
    replay.observe(frame(4), first=False)
    assert transitions(replay) == {(1, 0, 1.0, 2), (3, 1, 2.0, 4)}


def test_a_motion_cut_off_by_a_new_episode_is_no_transition() -> None:
    replay = Replay(8, image(1, 1))
    replay.observe(frame(1), first=True)
    replay.act(0, 1.0, terminated=False)  # the next frame never came
    replay.observe(frame(2), first=True)
    replay.act(1, 2.0, terminated=True)
    assert transitions(replay) == {(2, 1, 2.0, None)}


def test_the_ring_forgets_the_oldest_frames() -> None:
    replay = Replay(3, image(1, 1))
    for number in range(1, 6):
        replay.observe(frame(number), first=number == 1)
        replay.act(number % 4, float(number), terminated=False)
    # frames 3, 4, 5 are kept; 5 has no next one yet
    assert transitions(replay) == {(3, 3, 3.0, 4), (4, 0, 4.0, 5)}


def test_newest_draws_from_so_many_newest_frames_only() -> None:
    replay = Replay(4, image(1, 1))
    for number in range(1, 7):  # the ring holds 3, 4, 5, 6 and has wrapped round
        replay.observe(frame(number), first=False)
        replay.act(0, 0.0, terminated=False)
    assert {x for x, *_ in transitions(replay, newest=2)} == {5}  # of frames 5 and 6, 6 is not whole
    assert {x for x, *_ in transitions(replay, newest=3)} == {4, 5}
    assert {x for x, *_ in transitions(replay, newest=100)} == {3, 4, 5}


def test_a_sample_has_the_shapes_and_types_of_a_batch() -> None:
    replay = Replay(4, image(2, 3))
    replay.observe(np.zeros((2, 3, 4), np.uint8), first=True)
    replay.act(1, 2.5, terminated=True)
    batch = replay.sample(5, np.random.default_rng(0))
    assert batch.frames.shape == batch.next_frames.shape == (5, 2, 3, 4)
    assert batch.frames.dtype == np.uint8  # resized bytes, never floats
    assert (batch.actions.tolist(), batch.actions.dtype) == ([1] * 5, np.int64)
    assert (batch.rewards.tolist(), batch.rewards.dtype) == ([2.5] * 5, np.float32)
    assert (batch.terminated.tolist(), batch.terminated.dtype) == ([1.0] * 5, np.float32)


def test_sampling_from_nothing_is_an_error_not_garbage() -> None:
    with pytest.raises(TrainingError, match="no motion with the one after it among the newest 4 of 0; expected one"):
        Replay(4, image(1, 1)).sample(2, np.random.default_rng(0))


EPISODES = st.lists(st.tuples(st.integers(1, 6), st.booleans()), min_size=1, max_size=12)


@given(EPISODES, st.integers(2, 15))
def test_what_can_be_drawn_is_what_a_plain_list_of_frames_says(episodes: list[tuple[int, bool]], size: int) -> None:
    replay, seen = Replay(size, image(1, 1)), []  # seen: [frame, next frame | None | "cut"]
    number = 0
    for motions, terminated in episodes:
        for motion in range(motions):
            replay.observe(frame(number), first=motion == 0)
            last = motion == motions - 1
            replay.act(0, 0.0, terminated=last and terminated)
            seen.append((number, None if last and terminated else number + 1))
            number += 1
        replay.observe(frame(number), first=False)  # the last frame of the episode, without an action
        seen.append((number, "cut"))
        number += 1
    expected = {pair for pair in seen[-size:] if pair[1] != "cut"}
    assert len(replay) == len(expected)
    if expected:
        assert {(x, after) for x, _, _, after in transitions(replay)} <= expected
