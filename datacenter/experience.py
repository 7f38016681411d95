"""Motions as the data center keeps them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from jouleswarm.codecs.codec import Codec
from jouleswarm.codecs.observations import decode_experience
from jouleswarm.common.disk.state import State, Stateful
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import MotionHeader
from jouleswarm.common.wire.types import Payload
from jouleswarm.learning.replay import Replay


@dataclass(frozen=True)
class Motion:
    """One motion: what was seen, as a replay memory keeps it, and what the payload weighed."""

    frame: npt.NDArray[Any]
    header: MotionHeader
    payload_bytes: int = 0


def read_motion(payload: Payload, scenario: Scenario, codec: Codec) -> Motion:
    """A motion from the uplink, through the scenario's `codec` of experience.

    Raises:
        PayloadError: it is none of this scenario's observations, actions and codec.
    """
    spaces = scenario.spaces
    kept = spaces.observation.kept(scenario.network)
    frame, header = decode_experience(payload, codec, spaces.observation, kept)
    if header.action >= (actions := len(spaces.actions)):
        raise PayloadError(f"motion of robot {header.agent}: action {header.action}, expected 0 to {actions - 1}")
    return Motion(frame, header, len(payload))


class Walks:
    """Robots' walks on their way into one replay memory, a round of one robot at a time.

    A motion becomes a transition when the frame after it has come. After a round's last motion that is the next
    round's first frame: robots go on where they stand. Other robots' frames may have come between, so the last motion
    is held here until then and put in once more: no transition joins two robots, two episodes, or motions that do not
    follow one another. The last motion of a truncated episode never becomes one, for nothing was seen after it.
    """

    def __init__(self, replay: Replay, motions: Callable[[int], int]) -> None:
        """`motions`: of a robot's round."""
        self._replay, self._motions = replay, motions
        self._held: dict[int, Motion] = {}  # robot -> its newest motion, unless that ended an episode
        self._newest = 0  # the robot whose frame is the memory's newest

    def remember(self, motions: Iterable[Motion]) -> None:
        """Put in motions, each robot's in the order of time."""
        for motion in motions:
            agent = motion.header.agent
            before = self._held.pop(agent, None)
            follows = before is not None and self._follows(before.header, motion.header)
            if before is not None and follows and self._newest != agent:
                self._put(before, first=True)
            self._put(motion, first=not follows)
            self._newest = agent
            if not motion.header.terminated:
                self._held[agent] = motion

    def _put(self, motion: Motion, *, first: bool) -> None:
        header = motion.header
        self._replay.observe(motion.frame, first=first)
        self._replay.act(header.action, header.reward, terminated=header.terminated)

    def _follows(self, before: MotionHeader, after: MotionHeader) -> bool:
        # A robot that was left out of a round (federation.on_missing) has moved on meanwhile.
        if after.first:
            return False
        is_last = before.motion == self._motions(before.agent) - 1
        next_place = (before.round + 1, 0) if is_last else (before.round, before.motion + 1)
        return (after.round, after.motion) == next_place

    def state(self) -> State:
        """See `common.disk.state.Stateful`; the memory's own is apart."""
        frames = {str(agent): motion.frame for agent, motion in self._held.items()}
        headers = {str(agent): motion.header.model_dump(by_alias=True) for agent, motion in self._held.items()}
        return State(frames, {"newest": self._newest, "held": headers})

    def load_state(self, state: State) -> None:
        self._newest = state.values["newest"]
        self._held = {
            int(agent): Motion(state.arrays[agent], MotionHeader.model_validate(header))
            for agent, header in state.values["held"].items()
        }


class TrainingExperience:
    """What each training robot k has sent, E_ik: a replay memory of its own, and the walk on its way there."""

    def __init__(self, scenario: Scenario, folder: Path | None = None) -> None:
        """`folder`: for the frames, for who wants to go on from a state."""
        meta, kept = scenario.meta, scenario.spaces.observation.kept(scenario.network)

        def replay(agent: int) -> Replay:
            frames = folder and folder / f"frames-{agent}.bin"
            return Replay(meta.replay_size, kept, frames, 2 * scenario.motions(agent))

        self.replays = {
            task: {agent: replay(agent) for agent in agents} for task, agents in scenario.training_agents.items()
        }
        """Training task -> robot -> its memory."""
        memories = {agent: held for of_task in self.replays.values() for agent, held in of_task.items()}
        self._walks = {agent: Walks(held, scenario.motions) for agent, held in memories.items()}
        self._memories = memories

    def remember(self, motions: Sequence[Motion]) -> None:
        """Put in one robot's round, in the order of time."""
        if motions:
            self._walks[motions[0].header.agent].remember(motions)

    @property
    def kept(self) -> dict[str, Stateful]:
        """What is kept of it after a round."""
        replays = {f"replay-{agent}": held for agent, held in self._memories.items()}
        return {**replays, **{f"walks-{agent}": held for agent, held in self._walks.items()}}
