"""How a robot moves: learning episodes, greedy evaluation episodes, and experience for the data center."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jouleswarm.agents.choice import Choice, by_guide
from jouleswarm.agents.trial import Trial, greedy_episode
from jouleswarm.codecs.frames import shrink
from jouleswarm.codecs.observations import encode_experience, experience_codec_of
from jouleswarm.common.disk.state import State, generator_state, load_generator
from jouleswarm.common.meter.work import Tally
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import integer, stream
from jouleswarm.common.wire.messages import MotionHeader
from jouleswarm.common.wire.saved_models import Evaluation
from jouleswarm.environments.environment import Step, TaskEnvironment
from jouleswarm.learning.dqn import epsilon_greedy
from jouleswarm.learning.learner import Learner, Policy

Array = npt.NDArray[Any]
Options = Sequence[dict[str, Any]]

_ROUNDS_HELD = 4


class Place(NamedTuple):
    """In the middle of an episode."""

    environment: dict[str, Any]
    shown: Array | None
    """The newest observation; None where another look will do."""


class Motion(NamedTuple):
    """What was seen, what was done, and what that brought."""

    shown: Array
    action: int
    step: Step
    first: bool


class Explorer:
    """Robot `agent` in its environment."""

    def __init__(self, scenario: Scenario, agent: int) -> None:
        self._scenario, self._agent = scenario, agent
        self._task = scenario.task_of(agent)
        self._env, self._evaluation = (TaskEnvironment(scenario, self._task) for _ in range(2))
        self._kept, self._codec = scenario.spaces.observation.kept(scenario.network), experience_codec_of(scenario)
        self._evaluation.show(self._kept)
        self._arm, self._starts = "", self._starts_of(scenario.cluster(self._task), scenario.learning.starts)
        self._rng = stream(scenario.seed, "explore", agent)
        self._rounds = 0  # since `begin`
        self._frame: Array | None = None  # the newest observation, as it is kept
        self.tally = Tally()
        """Counts each motion as it is made, also of a round that is not kept."""
        self._is_under_way = False  # whether the episode that goes up to a data center goes on in the next round
        self._shown: Array | None = None  # its newest observation, where there is no other look
        self._places: dict[int, Place | None] = {0: None}  # where the newest meta-learning rounds left the robot
        self.evaluation: Evaluation | None = None
        """How the newest `evaluate` was begun, for who wants to see it again."""

    def begin(self, arm: str, cluster: Sequence[int]) -> None:
        """Start afresh, with random streams that depend on the arm alone; `cluster` shares the places to start from."""
        seed = self._scenario.seed
        self._arm, self._starts = arm, self._starts_of(cluster, self._scenario.learning.starts)
        self._rng = stream(seed, arm, "explore", self._agent)
        self._env.show(self._kept)
        self._env.reset(seed=integer(seed, arm, "environment", self._agent))
        self._evaluation.reset(seed=integer(seed, arm, "evaluation", self._agent))
        self._frame, self._shown, self._is_under_way, self._rounds = None, None, False, 0

    def state(self) -> State:
        """Where `begin` and what came after it have led to (see `common.disk.state.Stateful`)."""
        held = {"frame": self._frame, "shown": self._shown}
        arrays = {name: array for name, array in held.items() if array is not None}
        values: dict[str, Any] = {"rng": generator_state(self._rng), "rounds": self._rounds}
        if self._env.can_go_on:
            values |= {"place": self._env.place(), "noise": self._env.noise(), "evaluation": self._evaluation.noise()}
        return State(arrays, {**values, "under_way": self._is_under_way})

    def load_state(self, state: State) -> None:
        """Take up what `state` returned, after `begin`."""
        values = state.values
        self._frame, self._shown = state.arrays.get("frame"), state.arrays.get("shown")
        load_generator(self._rng, values["rng"])
        if self._env.can_go_on:
            self._env.load_place(values["place"])
            self._env.load_noise(values["noise"])
            self._evaluation.load_noise(values["evaluation"])
        self._is_under_way, self._rounds = values["under_way"], values["rounds"]

    def collect(self, learner: Learner, motions: int) -> int:
        """Move by `learning.collect`, from exploring starts, into the learner's replay; returns the transitions."""
        self._next_round()
        choose = self._choice(learner)
        for _ in range(motions):
            if self._frame is None:
                self._frame = self._small(self._env.reset(options=_choose(self._starts, self._rng)))
                learner.replay.observe(self._frame, first=True)
            action = choose(self._frame)
            step = self._env.step(action)
            self.tally.motion()
            learner.replay.act(action, step.reward, terminated=step.terminated)
            self._frame = self._small(step.observation)
            learner.replay.observe(self._frame, first=False)
            if step.ended:
                self._frame = None
        return motions

    def evaluate(self, policy: Policy) -> Trial:
        """One greedy episode."""
        return self._evaluate(policy, None if self._evaluation.can_go_on else self._seed("evaluation", self._rounds))

    def evaluate_at_start(self, policy: Policy, episodes: int) -> list[Trial]:
        """Greedy episodes before the first round, after `begin`; what later ones draw does not depend on them."""
        if not self._evaluation.can_go_on:
            return [self._evaluate(policy, self._seed("start", each)) for each in range(episodes)]
        noise = self._evaluation.noise()
        self._evaluation.reset(seed=self._seed("start", 0))
        trials = [self._evaluate(policy, None) for _ in range(episodes)]
        self._evaluation.load_noise(noise)
        return trials

    def _evaluate(self, policy: Policy, seed: int | None) -> Trial:
        discount, noise = self._scenario.learning.discount, self._evaluation.noise() if seed is None else None
        self.evaluation = Evaluation(discount=discount, noise=noise, seed=seed)
        return greedy_episode(self._evaluation, policy, self._small, seed, discount, self.tally)

    def motions(self, round_: int) -> Iterator[bytes]:
        """One meta-learning round's experience, a payload a motion, epsilon-greedy on the environment's guide.

        The walk goes on from round to round. It depends on nothing but scenario, robot and round, wherever the robot
        has been meanwhile: a round asked for again is the same to the bit.
        """
        known = max(each for each in self._places if each < round_)
        for before in range(known + 1, round_):  # walked before, by another process or long ago
            for _ in self._meta_round(before):
                pass
        yield from self._sent(round_, self._meta_round(round_))

    def policy_motions(self, policy: Policy, round_: int) -> Iterator[bytes]:
        """One round's experience for a data center that learns the task and sent `policy`, its newest model.

        It moves and goes on from round to round as in `collect`.
        """
        self._env.show(None)  # what goes up is as the environment shows it
        self._next_round()
        yield from self._sent(round_, self._walk(self._choice(policy), self._starts, self._rng))

    def _sent(self, round_: int, motions: Iterator[Motion]) -> Iterator[bytes]:
        """A round's motions as payloads."""
        for index, motion in enumerate(motions):
            self.tally.motion()
            header = MotionHeader(
                task=self._task,
                agent=self._agent,
                round=round_,
                motion=index,
                action=motion.action,
                reward=motion.step.reward,
                first=motion.first,
                terminated=motion.step.terminated,
            )
            yield encode_experience(motion.shown, header, self._codec)

    def _walk(self, choose: Choice, starts: Options, rng: np.random.Generator) -> Iterator[Motion]:
        """A round's motions; it begins with another look from where the round before ended."""
        if self._is_under_way:
            shown = self._env.look() if self._shown is None else self._shown
        for _ in range(self._scenario.motions(self._agent)):
            first = not self._is_under_way
            if first:
                shown = self._env.reset(options=_choose(starts, rng))
            action = choose(shown)
            step = self._env.step(action)
            self._is_under_way = not step.ended
            yield Motion(shown, action, step, first)
            shown = step.observation
        self._shown = shown if self._is_under_way and not self._env.can_look else None

    def _meta_round(self, round_: int) -> Iterator[Motion]:
        """The motions of a meta-learning round, after the round before."""
        rng = stream(self._scenario.seed, "meta", "explore", self._agent, round_)
        place = self._places[round_ - 1]
        self._env.show(None)
        self._env.reset(seed=integer(self._scenario.seed, "meta", "environment", self._agent, round_))
        self._is_under_way, self._shown = place is not None, None
        if place is not None:
            self._env.load_place(place.environment)
            self._shown = place.shown
        yield from self._walk(by_guide(self._env, self._scenario.meta_epsilon, rng), self._meta_starts, rng)
        goes_on = self._is_under_way and self._env.can_go_on
        self._places.pop(round_, None)
        self._places[round_] = Place(self._env.place(), self._shown) if goes_on else None
        for old in list(self._places)[1:-_ROUNDS_HELD]:  # the first is where every walk begins
            del self._places[old]

    @cached_property
    def _meta_starts(self) -> Options:
        return self._starts_of(self._scenario.cluster(self._task), self._scenario.meta_starts)

    def _choice(self, policy: Policy) -> Choice:
        """How a robot collects that learns itself, or is sent what the data center has learned."""
        learning = self._scenario.learning
        if learning.collect == "guide" and self._env.has_guide:
            return by_guide(self._env, learning.epsilon, self._rng)
        return lambda shown: epsilon_greedy(policy.q_values(self._small(shown)), learning.epsilon, self._rng)

    def _starts_of(self, cluster: Sequence[int], where: str) -> Options:
        return self._env.starts(where, cluster.index(self._agent), len(cluster))

    def _next_round(self) -> None:
        """Where the environment cannot tell where it stands, nothing goes on from the round before."""
        self._rounds += 1
        if not self._env.can_go_on:
            self._env.reset(seed=self._seed("environment", self._rounds))
            self._frame, self._shown, self._is_under_way = None, None, False

    def _seed(self, purpose: str, number: int) -> int:
        return integer(self._scenario.seed, self._arm, purpose, self._agent, number)

    def _small(self, observation: Array) -> Array:
        return shrink(observation, self._kept)


def _choose(starts: Options, rng: np.random.Generator) -> dict[str, Any]:
    return starts[int(rng.integers(len(starts)))]
