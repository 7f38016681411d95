"""The environment door: what a robot asks of its environment, and what is made up for one that does not offer it.

Any gymnasium.Env with observations in a Box or a Discrete space and Discrete actions will do. More is asked of
`env.unwrapped`, where it is there:

- `state()`, `load_state(state)`: plain values of all that a step depends on but `np_random`, which is kept for it.
  Without, nothing can go on in the middle: each round begins by `reset(seed=...)`, seeded by robot, arm and round.
- `look()`: another observation from where it stands, as `reset` returns it. Without, the last one is kept.
- `show_as(shape)`: show observations of this shape from now on, or with None such as the space says; returns whether it
  does. Without, images are shrunk after they were drawn.
- `guide()`: the next action of a known good policy, for the data center's experience. Without, random actions.
- `start(where, share, shares)`: `reset` options for `learning.starts`, one dict or several that are drawn from.
  Without, none.
- `judge(total)`: what an episode that brought the discounted return `total` counts, and named measures of it.
  Without, `total` and none.
"""

from __future__ import annotations

import json
import math
import traceback
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from jouleswarm.common.disk.state import generator_state, load_generator
from jouleswarm.common.errors import ConfigurationError, JouleSwarmError, RunError
from jouleswarm.common.scenario.environments import first_line, spaces_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.messages import MAX_REWARD

Array = npt.NDArray[Any]
Options = dict[str, Any] | None


class Environment(Protocol):
    """What a factory returns is a gymnasium.Env; these may be missing."""

    def state(self) -> dict[str, Any]: ...
    def load_state(self, state: dict[str, Any]) -> None: ...
    def look(self) -> tuple[Any, dict[str, Any]]: ...
    def show_as(self, shape: tuple[int, ...] | None) -> bool: ...
    def guide(self) -> int: ...
    def start(self, where: str, share: int, shares: int) -> Options | Sequence[Options]: ...
    def judge(self, total: float) -> tuple[float, dict[str, float]]: ...


class Step(NamedTuple):
    """What an action brought."""

    observation: Array
    reward: float
    terminated: bool
    truncated: bool

    @property
    def ended(self) -> bool:
        """Whether the episode is over."""
        return self.terminated or self.truncated


class TaskEnvironment:
    """A task's environment, for one robot and one purpose; actions are counted from 0, whatever its space does."""

    def __init__(self, scenario: Scenario, task: int) -> None:
        """
        Raises:
            ConfigurationError: it cannot be made, or has other spaces than the scenario's first task.
        """
        self._what = f"environment {scenario.environment!r}, task {task}"
        self._env = scenario.make(task)
        found, self.spaces = spaces_of(self._env, self._what), scenario.spaces
        if found != self.spaces:
            raise ConfigurationError(
                f"{self._what}: {found}; expected {self.spaces}, as of task {scenario.tasks[0].id}: all tasks of a "
                "scenario have the same"
            )
        self._seen = self.spaces.observation
        self._first_value = int(getattr(self._env.observation_space, "start", 0))
        self._first_action = int(getattr(self._env.action_space, "start", 0))
        self._most, self._steps = scenario.learning.max_episode_steps, 0
        self.can_go_on = self._has("state")
        if self.can_go_on != self._has("load_state"):
            raise ConfigurationError(f"{self._what}: has one of state() and load_state(), expected both or none")
        self.can_look, self.has_guide = self._has("look"), self._has("guide")

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Array:
        """Begin an episode; the observation is an array of its own."""
        observation, _ = self._asked("reset", lambda: self._env.reset(seed=seed, options=options or None), 2)
        self._steps = 0
        return self._read(observation)

    def look(self) -> Array:
        """Another observation from where it stands; only where `can_look`."""
        return self._read(self._asked("look", self._env.unwrapped.look, 2)[0])

    def show(self, kept: Observation | None) -> None:
        """Have observations shown as they are `kept` from now on, where the environment can, or as its space says."""
        if not self._has("show_as"):
            return
        shape = None if kept is None else kept.shape
        does = self._asked("show_as", lambda: bool(self._env.unwrapped.show_as(shape)))
        self._seen = kept if kept is not None and does else self.spaces.observation

    def step(self, action: int) -> Step:
        """Take an action, counted from 0."""
        taken = self._first_action + action
        observation, reward, terminated, truncated, _ = self._asked("step", lambda: self._env.step(taken), 5)
        reward = self._asked("reward", lambda: float(reward))
        if not (math.isfinite(reward) and abs(reward) <= MAX_REWARD):
            raise RunError(f"{self._what}: a reward of {reward}, expected a number within {MAX_REWARD:g}")
        self._steps += 1
        is_cut = not terminated and (bool(truncated) or self._steps >= self._most)
        return Step(self._read(observation), reward, bool(terminated), is_cut)

    def guide(self) -> int:
        """The next action of a known good policy, counted from 0; only where `has_guide`."""
        action: int = self._asked("guide", lambda: int(self._env.unwrapped.guide())) - self._first_action
        if not 0 <= action < len(self.spaces.actions):
            raise RunError(f"{self._what}: guide() gave {action + self._first_action}, which is no action")
        return action

    def starts(self, where: str, share: int, shares: int) -> Sequence[dict[str, Any]]:
        """Options of `reset`, of which each episode draws one."""
        if not self._has("start"):
            return [{}]
        found = self._asked("start", lambda: self._env.unwrapped.start(where, share, shares))
        options = found if isinstance(found, list | tuple) else [found]
        if not options or not all(each is None or isinstance(each, dict) for each in options):
            raise RunError(f"{self._what}: start() gave {found!r}, expected options of reset, or a list of them")
        return [each or {} for each in options]

    def judge(self, total: float) -> tuple[float, dict[str, float]]:
        """What the episode that has ended counts, and measures of it."""
        if not self._has("judge"):
            return total, {}
        counts, told = self._asked("judge", lambda: self._env.unwrapped.judge(total), 2)
        measures = self._asked("judge", lambda: {str(name): float(value) for name, value in told.items()})
        if not all(map(math.isfinite, (counts, *measures.values()))) or abs(counts) > MAX_REWARD:
            raise RunError(f"{self._what}: judge() gave {counts}, {measures}; expected finite numbers")
        return float(counts), measures

    def noise(self) -> dict[str, Any]:
        """What its random generator will draw."""
        return generator_state(self._env.unwrapped.np_random)

    def load_noise(self, state: dict[str, Any]) -> None:
        """Take up what `noise` returned."""
        load_generator(self._env.unwrapped.np_random, state)

    def place(self) -> dict[str, Any]:
        """Where it stands, without its random generator; only where `can_go_on`."""
        told = self._asked("state", self._env.unwrapped.state)
        try:
            own = json.loads(json.dumps(told, default=_plain))  # also so that nothing in it changes later
        except (TypeError, ValueError) as error:
            raise RunError(f"{self._what}: state() is not of plain values: {error}") from error
        return {"own": own, "steps": self._steps}

    def load_place(self, place: dict[str, Any]) -> None:
        """Take up what `place` returned, after a `reset`."""
        self._asked("load_state", lambda: self._env.unwrapped.load_state(place["own"]))
        self._steps = place["steps"]
        for layer in _layers(self._env):
            if hasattr(layer, "_elapsed_steps"):  # gymnasium.wrappers.TimeLimit, which counts for itself
                layer._elapsed_steps = self._steps

    def _has(self, word: str) -> bool:
        return callable(getattr(self._env.unwrapped, word, None))  # some have plain data of that name

    def _read(self, observation: Any) -> Array:
        seen = self._seen
        try:
            array = np.array(observation, seen.dtype, order="C")
            array = array - array.dtype.type(self._first_value) if self._first_value else array
        except (TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{self._what}: an observation that is no {seen}: {first_line(error)}") from error
        array = np.asarray(array)
        if reason := seen.misfit(array):
            raise RunError(f"{self._what}: an observation {reason}; expected {seen}")
        return array

    def _asked(self, word: str, call: Callable[[], Any], parts: int = 0) -> Any:
        """What the environment answers, in so many parts; whatever goes wrong in it is one line with the place."""
        try:
            answer = call()
        except JouleSwarmError:
            raise
        except Exception as error:  # whatever somebody's environment does
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{frame.filename}, line {frame.lineno}"
            raise RunError(f"{self._what}: {word}: {type(error).__name__}: {first_line(error)} ({where})") from error
        if parts and not (isinstance(answer, tuple | list) and len(answer) == parts):
            got = f"{len(answer)} values" if isinstance(answer, tuple) else f"a {type(answer).__name__}"
            raise RunError(f"{self._what}: {word}() gave {got}, expected {parts} values")
        return answer


def _layers(environment: Any) -> list[Any]:
    """An environment and all that it is wrapped in, the outermost first."""
    found = [environment]
    while hasattr(found[-1], "env"):
        found.append(found[-1].env)
    return found


def _plain(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"got a {type(value).__name__}, expected numbers, text, lists and dictionaries of them")
