"""Tiny environments, to be named in scenarios as `tests.worlds:NAME`."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from jouleswarm.common.scenario.sections import Section

BUFFER = np.zeros(3, np.float32)


class Line(gymnasium.Env[Any, Any]):
    """A line of places 0, 1, 2, ...: action 1 goes on by a place, action 0 stays; the reward is the place.

    It ends at `end`. Observations are float32 [place, noise, 1]: noise is drawn anew each time from np_random.
    """

    observation_space: spaces.Space[Any] = spaces.Box(-np.inf, np.inf, (3,), np.float32)
    action_space: spaces.Space[Any] = spaces.Discrete(2)

    def __init__(self, end: int = 4) -> None:
        self.end, self.at = end, 0

    def seen(self) -> Any:
        BUFFER[:] = self.at, self.np_random.normal(), 1.0
        return BUFFER  # the same array each time, as some environments have it

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.at = (options or {}).get("at", 0)
        return self.seen(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.at += int(action)
        return self.seen(), float(self.at), self.at >= self.end, False, {}


class Known(Line):
    """The same, with all that may be asked of an environment but another look."""

    def state(self) -> dict[str, Any]:
        return {"at": np.int64(self.at)}

    def load_state(self, state: dict[str, Any]) -> None:
        self.at = state["at"]

    def guide(self) -> int:
        return 1

    def start(self, where: str, share: int, shares: int) -> list[dict[str, Any]]:
        return [{"at": 1}] if where == "area" else [{"at": 0}]

    def judge(self, total: float) -> tuple[float, dict[str, float]]:
        return 2 * total, {"place": self.at}


class Looking(Known):
    """And with another look."""

    def look(self) -> tuple[Any, dict[str, Any]]:
        return self.seen(), {}


class Half(Line):
    """It tells where it stands, and cannot be told."""

    def state(self) -> dict[str, Any]:
        return {}


class Numbers(Line):
    """Observations are numbers from 5 to 19, actions -1 and 0."""

    observation_space = spaces.Discrete(15, start=5)
    action_space = spaces.Discrete(2, start=-1)

    def seen(self) -> int:
        return 5 + self.at

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert action in (-1, 0)
        return super().step(int(action) + 1)


class Pictures(Line):
    """Observations are uint8 [4, 6, 3]."""

    metadata = {"actions": ("stay", "go"), "channels": ("red", "green", "blue")}  # noqa: RUF012
    observation_space = spaces.Box(0, 255, (4, 6, 3), np.uint8)

    def seen(self) -> Any:
        return np.full((4, 6, 3), 10 * self.at, np.uint8)


class Continuous(Line):
    action_space = spaces.Box(-1, 1, (1,), np.float32)


class Odd(Line):
    """Each of its rewards, and its observation after the first, is what it is told."""

    def __init__(self, reward: float = 0.0, observation: Any = (0, 0, 0), error: str = "") -> None:
        super().__init__()
        self.reward, self.observation, self.error = reward, observation, error

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        if self.error:
            raise ValueError(self.error)
        return np.array(self.observation), float(self.reward), False, False, {}


def refuses() -> gymnasium.Env[Any, Any]:
    raise OSError("no simulator here\nand more")


def nothing() -> None:
    return None


class Maze(Section):
    """A table of a scenario."""

    walls: int = 3


class Walls(Line):
    """As many numbers are seen as there are walls."""

    def __init__(self, walls: int, maze: Maze) -> None:
        super().__init__()
        self.observation_space = spaces.Box(0, 1, (walls + maze.walls,), np.float32)


def maze(maze: Maze, walls: int = 0) -> Walls:
    return Walls(walls, maze)


maze.sections = {"maze": Maze}  # type: ignore[attr-defined]
maze.defaults = {"learning": {"epsilon": 0.5, "lr": 0.25}}  # type: ignore[attr-defined]
