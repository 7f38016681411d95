"""Robots' walks in one replay memory of the data center: which motions become transitions, and when.

A motion's frame is 100 x robot + how many motions the robot has walked before; its reward is the same number.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jouleswarm.codecs.observations import experience_codec_of
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.wire.messages import MotionHeader
from jouleswarm.datacenter.experience import Motion, Walks, read_motion
from jouleswarm.learning.replay import Replay
from tests.made_up import encode_motion, image

M = 3  # motions a round
Transitions = set[tuple[int, int | None]]


def walk(agent: int, round_: int, *, firsts: tuple[int, ...] = (0,), terminated: tuple[int, ...] = ()) -> list[Motion]:
    """A robot's round; `firsts` and `terminated` are motions walked."""
    numbers = [(round_ - 1) * M + index for index in range(M)]
    return [
        Motion(
            np.full((1, 1, 4), 100 * agent + number, np.uint8),
            MotionHeader(
                task=1, agent=agent, round=round_, motion=index, action=0, reward=100 * agent + number,
                first=number in firsts, terminated=number in terminated,
            ),
        )
        for index, number in enumerate(numbers)
    ]  # fmt: skip


def transitions(replay: Replay) -> Transitions:
    """(reward of a motion, next frame or None where the episode ended), all that can be drawn; frames are checked."""
    batch = replay.sample(500, np.random.default_rng(0))
    assert [int(frame[0, 0, 0]) for frame in batch.frames] == batch.rewards.tolist()
    return {
        (int(reward), None if done else int(after[0, 0, 0]))
        for reward, after, done in zip(batch.rewards, batch.next_frames, batch.terminated, strict=True)
    }


def test_a_round_s_last_motion_becomes_a_transition_with_the_next_round() -> None:
    replay = Replay(50, image(1, 1))
    walks = Walks(replay, lambda agent: M)
    walks.remember(walk(1, 1))
    assert transitions(replay) == {(100, 101), (101, 102)}
    walks.remember(walk(1, 2))
    assert transitions(replay) == {(100, 101), (101, 102), (102, 103), (103, 104), (104, 105)}


def test_robots_of_one_memory_are_kept_apart() -> None:
    replay = Replay(50, image(1, 1))
    walks = Walks(replay, lambda agent: M)
    for round_ in (1, 2):
        for agent in (1, 2):
            walks.remember(walk(agent, round_))
    one, two = {(100 + n, 101 + n) for n in range(5)}, {(200 + n, 201 + n) for n in range(5)}
    assert transitions(replay) == one | two


def test_a_truncated_episode_s_last_motion_never_becomes_one_and_a_terminated_one_is_whole() -> None:
    replay = Replay(50, image(1, 1))
    walks = Walks(replay, lambda agent: M)
    walks.remember(walk(1, 1, firsts=(0, 2), terminated=(2,)))  # truncated after two motions; then one to the exit
    walks.remember(walk(1, 2, firsts=(3,)))
    assert transitions(replay) == {(100, 101), (102, None), (103, 104), (104, 105)}


@pytest.mark.parametrize("agents", [(1,), (1, 2)])
def test_a_walk_with_a_gap_is_not_joined(agents: tuple[int, ...]) -> None:
    replay = Replay(50, image(1, 1))
    walks = Walks(replay, lambda agent: M)
    for agent in agents:
        walks.remember(walk(agent, 1))
    left_out = walk(1, 3)  # it was left out of round 2, and one motion of its third is missing
    walks.remember([left_out[0], left_out[2]])
    expected = {(100 * agent + n, 100 * agent + n + 1) for agent in agents for n in (0, 1)}
    assert transitions(replay) == expected


@pytest.mark.parametrize("agents", [(1,), (1, 2)])
def test_what_is_held_comes_back_with_the_state(agents: tuple[int, ...], tmp_path: Path) -> None:
    ours, theirs = Replay(50, image(1, 1), tmp_path / "a.bin"), Replay(50, image(1, 1))
    walks, back = Walks(ours, lambda agent: M), Walks(theirs, lambda agent: M)
    for agent in agents:
        walks.remember(walk(agent, 1))
        back.remember(walk(agent, 1))  # for the frames, which are not in the state
    file = StateFile(tmp_path / "s", "o")
    file.save(walks.state())
    state = file.load()
    assert state is not None
    again = Walks(theirs, lambda agent: M)
    again.load_state(state)
    for agent in agents:
        walks.remember(walk(agent, 2))
        again.remember(walk(agent, 2))
    assert transitions(theirs) == transitions(ours)
    assert len(ours) == 5 * len(agents)


@pytest.mark.parametrize(("action", "refused"), [(1, False), (2, True)])
def test_a_motion_of_an_action_that_is_none_is_refused(action: int, refused: bool) -> None:
    data = {"name": "t", "methods": ["fl"], "environment": "tests.worlds:Line", "tasks": [{"id": 1}]}
    header = MotionHeader(task=1, agent=1, round=1, motion=0, action=action, reward=0, first=True, terminated=False)
    payload, scenario = encode_motion(np.zeros(3, np.float32), header), scenario_from(data, "test")
    if refused:
        with pytest.raises(PayloadError, match="robot 1: action 2, expected 0 to 1"):
            read_motion(payload, scenario, experience_codec_of(scenario))
    else:
        assert read_motion(payload, scenario, experience_codec_of(scenario)).payload_bytes == len(payload)
