"""How a robot moves: learning episodes, greedy evaluation episodes, and experience for the data center."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from agents.environment import LandmarksEnv
from agents.tasks import ACTIONS, rmse_m, start_cells, table_policy, task_table
from common.dqn import epsilon_greedy
from common.experience import encode_experience
from common.frames import resize
from common.learner import Learner, Policy
from common.maps import Cell
from common.payloads import MotionHeader
from common.savedmodel import Evaluation
from common.scenario import Scenario
from common.seeding import integer, stream
from common.settings import Starts
from common.state import State, generator_state, load_generator

Frame = npt.NDArray[np.uint8]


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
        self._frame = None

    def state(self) -> State:
        """Where `begin` and what came after it have led to (see `common.state.Stateful`)."""
        arrays = {} if self._frame is None else {"frame": self._frame}
        values = {"rng": generator_state(self._rng), "evaluation": self._evaluation.state(), "env": self._env.state()}
        return State(arrays, values)

    def load_state(self, state: State) -> None:
        """Take up what `state` returned, after `begin`."""
        self._frame = state.arrays.get("frame")
        load_generator(self._rng, state.values["rng"])
        self._evaluation.load_state(state.values["evaluation"])
        self._env.load_state(state.values["env"])

    def collect(self, learner: Learner, motions: int) -> int:
        """Move epsilon-greedily, from exploring starts, into the learner's replay; returns the transitions."""
        epsilon = self._scenario.learning.epsilon
        for _ in range(motions):
            if self._frame is None:
                self._frame = self._start()
                learner.replay.observe(self._frame, first=True)
            action = epsilon_greedy(learner.q_values(self._frame), epsilon, self._rng)
            frame, reward, terminated, truncated, _ = self._env.step(action)
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

        Depends on nothing but scenario, robot and round: a round asked for again is the same to the bit.
        """
        scenario, epsilon = self._scenario, self._scenario.meta.epsilon
        rng = stream(scenario.seed, "meta", "explore", self._agent, round_)
        best = self._best
        self._starts = self._start_cells(scenario.cluster(self._task), scenario.meta.starts)
        self._env.reset(seed=integer(scenario.seed, "meta", "environment", self._agent, round_))

        def choose(frame: Frame, cell: Cell) -> int:
            return int(rng.integers(len(ACTIONS))) if rng.random() < epsilon else int(best[cell])

        yield from self._encoded(round_, choose, rng)

    def policy_motions(self, policy: Policy, round_: int) -> Iterator[bytes]:
        """One round's experience for a data center that learns the task, epsilon-greedy on its own model."""
        epsilon = self._scenario.learning.epsilon

        def choose(frame: Frame, cell: Cell) -> int:
            return epsilon_greedy(policy.q_values(self._resized(frame)), epsilon, self._rng)

        yield from self._encoded(round_, choose, self._rng)

    def _encoded(self, round_: int, choose: Callable[[Frame, Cell], int], rng: np.random.Generator) -> Iterator[bytes]:
        """A round's motions as payloads; it begins with an episode of its own."""
        network, codec, first = self._scenario.network, self._scenario.meta.experience_codec, True
        for motion in range(self._scenario.learning.motions_per_round):
            if first:
                frame, info = self._env.reset(options={"start": _choose(self._starts, rng)})
            action = choose(frame, info["cell"])
            next_frame, reward, terminated, truncated, info = self._env.step(action)
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
            frame, first = next_frame, terminated or truncated

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
