"""How a robot moves: learning episodes, greedy evaluation episodes, and experience for the data center."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jouleswarm.codecs.frames import resize
from jouleswarm.codecs.observations import encode_experience
from jouleswarm.common.disk.state import State, generator_state, load_generator
from jouleswarm.common.meter.work import Tally
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Starts
from jouleswarm.common.seeding import integer, stream
from jouleswarm.common.wire.messages import MotionHeader
from jouleswarm.common.wire.saved_models import Evaluation
from jouleswarm.environments.landmarks.environment import LandmarksEnv
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.tasks import ACTIONS, move, rmse_m, start_cells, table_policy, task_table
from jouleswarm.learning.dqn import epsilon_greedy
from jouleswarm.learning.learner import Learner, Policy

Frame = npt.NDArray[np.uint8]


class Place(NamedTuple):
    """In the middle of an episode; as in `LandmarksEnv.state`."""

    cell: Cell
    motions: int


class Explorer:
    """Robot `agent` in its environment."""

    def __init__(self, scenario: Scenario, agent: int) -> None:
        self._scenario, self._agent = scenario, agent
        self._task = scenario.task_of(agent)
        self._map = scenario.task_map(self._task)
        self._table = task_table(scenario, self._task)
        self._env = LandmarksEnv(task=self._task, scenario=scenario)
        self._evaluation = LandmarksEnv(task=self._task, scenario=scenario, camera=self._env.camera)
        self._starts = self._start_cells(scenario.cluster(self._task), scenario.learning.starts)
        self._rng = stream(scenario.seed, "explore", agent)
        self._frame: Frame | None = None
        self.tally = Tally()
        """Counts each motion as it is made, also of a round that is not kept."""
        self._is_under_way = False  # whether the episode that goes up to a data center goes on in the next round
        self._places: list[Place | None] = [None]  # where a meta-learning round leaves the robot, from round 0 on
        self.evaluation: Evaluation | None = None
        """How the newest `evaluate` was begun, for who wants to see it again."""

    @cached_property
    def _best(self) -> npt.NDArray[np.int64]:
        """The best action at each landmark by the position-reward table."""
        return table_policy(self._table, self._map, self._scenario.learning.discount)

    def begin(self, arm: str, cluster: Sequence[int]) -> None:
        """Start afresh, with random streams that depend on the arm and not on what came before it.

        `cluster`: the robots that share the landmarks to start from.
        """
        seed = self._scenario.seed
        self._starts = self._start_cells(cluster, self._scenario.learning.starts)
        self._rng = stream(seed, arm, "explore", self._agent)
        self._env.reset(seed=integer(seed, arm, "environment", self._agent))
        self._evaluation.reset(seed=integer(seed, arm, "evaluation", self._agent))
        self._frame, self._is_under_way = None, False

    def state(self) -> State:
        """Where `begin` and what came after it have led to (see `common.disk.state.Stateful`)."""
        arrays = {} if self._frame is None else {"frame": self._frame}
        values = {"rng": generator_state(self._rng), "evaluation": self._evaluation.state(), "env": self._env.state()}
        return State(arrays, {**values, "under_way": self._is_under_way})

    def load_state(self, state: State) -> None:
        """Take up what `state` returned, after `begin`."""
        self._frame = state.arrays.get("frame")
        load_generator(self._rng, state.values["rng"])
        self._evaluation.load_state(state.values["evaluation"])
        self._env.load_state(state.values["env"])
        self._is_under_way = state.values["under_way"]

    def collect(self, learner: Learner, motions: int) -> int:
        """Move epsilon-greedily, from exploring starts, into the learner's replay; returns the transitions."""
        epsilon = self._scenario.learning.epsilon
        for _ in range(motions):
            if self._frame is None:
                self._frame = self._start()
                learner.replay.observe(self._frame, first=True)
            action = epsilon_greedy(learner.q_values(self._frame), epsilon, self._rng)
            frame, reward, terminated, truncated, _ = self._env.step(action)
            self.tally.motion()
            learner.replay.act(action, float(reward), terminated=terminated)
            self._frame = self._resized(frame)
            learner.replay.observe(self._frame, first=False)
            if terminated or truncated:
                self._frame = None
        return motions

    def evaluate(self, policy: Policy) -> tuple[float, float]:
        """One greedy episode from the entry: its discounted return and the RMSE of its path, metres.

        An episode that does not reach the exit never counts above 0 (DESIGN: it counts only with its exit).
        """
        discount = self._scenario.learning.discount
        self.evaluation = Evaluation(discount=discount, noise=self._evaluation.state()["rng"])
        frame, info = self._evaluation.reset(options={"start": "entry"})
        walked, total, factor, ended, terminated = [info["cell"]], 0.0, 1.0, False, False
        while not ended:
            action = int(policy.q_values(self._resized(frame)).argmax())
            frame, reward, terminated, truncated, info = self._evaluation.step(action)
            total += factor * float(reward)
            factor *= discount
            walked.append(info["cell"])
            ended = terminated or truncated
        error_m = rmse_m(walked, self._map, self._scenario.world.cell_m)
        return total if terminated else min(total, 0.0), error_m

    def motions(self, round_: int) -> Iterator[bytes]:
        """One meta-learning round's experience, a payload a motion, epsilon-greedy on the position-reward table.

        The walk goes on from round to round. It depends on nothing but scenario, robot and round, wherever the robot
        has been meanwhile: a round asked for again is the same to the bit.
        """
        rng, place = self._meta_stream(round_), self._place_after(round_ - 1)
        self._starts = self._meta_starts
        self._env.reset(seed=integer(self._scenario.seed, "meta", "environment", self._agent, round_))
        self._is_under_way = place is not None
        if place is not None:
            self._env.load_state({**self._env.state(), **place._asdict()})
        yield from self._encoded(round_, lambda frame, cell: self._table_action(cell, rng), rng)

    def policy_motions(self, policy: Policy, round_: int) -> Iterator[bytes]:
        """One round's experience for a data center that learns the task, epsilon-greedy on its own model.

        The walk goes on from round to round, as in `collect`.
        """
        epsilon = self._scenario.learning.epsilon

        def choose(frame: Frame, cell: Cell) -> int:
            return epsilon_greedy(policy.q_values(self._resized(frame)), epsilon, self._rng)

        yield from self._encoded(round_, choose, self._rng)

    def _encoded(self, round_: int, choose: Callable[[Frame, Cell], int], rng: np.random.Generator) -> Iterator[bytes]:
        """A round's motions as payloads; it begins with another look from where the round before ended."""
        network, codec = self._scenario.network, self._scenario.meta.experience_codec
        if self._is_under_way:
            frame, info = self._env.look()
        for motion in range(self._scenario.motions(self._agent)):
            first = not self._is_under_way
            if first:
                frame, info = self._env.reset(options={"start": _choose(self._starts, rng)})
            action = choose(frame, info["cell"])
            next_frame, reward, terminated, truncated, info = self._env.step(action)
            self.tally.motion()
            self._is_under_way = not (terminated or truncated)
            header = MotionHeader(
                task=self._task,
                agent=self._agent,
                round=round_,
                motion=motion,
                action=action,
                reward=float(reward),
                first=first,
                terminated=terminated,
            )
            yield encode_experience(frame, header, codec, network.width, network.height)
            frame = next_frame

    @cached_property
    def _meta_starts(self) -> Sequence[Cell]:
        return self._start_cells(self._scenario.cluster(self._task), self._scenario.meta.starts)

    def _meta_stream(self, round_: int) -> np.random.Generator:
        return stream(self._scenario.seed, "meta", "explore", self._agent, round_)

    def _table_action(self, cell: Cell, rng: np.random.Generator) -> int:
        is_random = rng.random() < self._scenario.meta.epsilon
        return int(rng.integers(len(ACTIONS))) if is_random else int(self._best[cell])

    def _place_after(self, round_: int) -> Place | None:
        """Where meta-learning round `round_` leaves the robot; None between two episodes.

        Found by walking all rounds up to it by the same draws, without a camera.
        """
        while len(self._places) <= round_:
            rng, place = self._meta_stream(len(self._places)), self._places[-1]
            for _ in range(self._scenario.motions(self._agent)):
                cell, done = place or (_choose(self._meta_starts, rng), 0)
                cell = move(cell, self._table_action(cell, rng), self._map.rows, self._map.cols)
                is_over = cell == self._map.exit or done + 1 >= self._scenario.world.max_motions
                place = None if is_over else Place(cell, done + 1)
            self._places.append(place)
        return self._places[round_]

    def _start(self) -> Frame:
        frame, _ = self._env.reset(options={"start": _choose(self._starts, self._rng)})
        return self._resized(frame)

    def _start_cells(self, cluster: Sequence[int], starts: Starts) -> Sequence[Cell]:
        if starts == "entry":
            return [self._map.entry]
        if starts == "anywhere":
            return start_cells(self._map, 0, 1)
        return start_cells(self._map, cluster.index(self._agent), len(cluster))

    def _resized(self, frame: Frame) -> Frame:
        return resize(frame, self._scenario.network.width, self._scenario.network.height)


def _choose(cells: Sequence[Cell], rng: np.random.Generator) -> Cell:
    return cells[int(rng.integers(len(cells)))]
