"""The landmark world as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.cameras import Frame, Frames, camera_in_use, new_camera
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.settings import ACTION_NAMES, CHANNELS, camera_of, task_map, world_of
from jouleswarm.environments.landmarks.tasks import (
    ACTIONS,
    move,
    rmse_m,
    start_cells,
    table_policy,
    task_table,
)
from jouleswarm.environments.landmarks.view import map_picture, side_by_side
from jouleswarm.environments.landmarks.window import Window

Info = dict[str, Any]


class LandmarksEnv(gymnasium.Env[Frame, np.int64]):
    """A robot moves from landmark to landmark and sees the world through its cameras.

    Action space: Discrete(4): 0 forward (row + 1), 1 backward (row - 1), 2 left (column - 1), 3 right (column + 1);
        Python's or NumPy's integers, nothing else. One motion goes to the next landmark; off the grid's edge the
        robot stays. Its heading never changes.
    Observation space: Box(0, 255, (height, width, 4), uint8): red, green, blue and time-of-flight depth
        (see `environments.landmarks.camera`); 640 x 480 by default. No two frames at one landmark are the same.
    Reward: the position-reward table's value at the landmark arrived at (see `landmarks.tasks.reward_table`).
    Start: the map's entry. `reset(options={"start": ...})` takes "entry", "random" (any landmark but the exit and
        obstacles) or a (row, column); there is no other option.
    End: terminated at the exit; truncated after max_motions motions anywhere else, so a truncated episode's last
        landmark still has a value.
    Info: `cell` (row, column), `position_m` (the same in metres), `reached_exit`.

    Arguments:
        task: id of the scenario's task; default its first.
        scenario: a Scenario or a scenario file; default the paper's six tasks.
        render_mode: None, "rgb_array" (the camera's newest picture), "map" (the grid from above with path and walk) or
            "human" (both, in a window that follows by itself; needs pygame: jouleswarm[render]).
        camera: another environment's `camera`, of the same scenario, to share its memory; in one thread only.

    Beside what Gymnasium asks for it offers all that a robot may ask of its environment (see
    `environments.environment`): `state`, `look`, `show_as`, `guide`, `start` and `judge`.

    Raises:
        ConfigurationError: the scenario cannot be read, has no such task, a start is not on the grid, or an option of
            `reset` is not known.
        gymnasium.error.InvalidAction: an action that is none of the four.
        gymnasium.error.ResetNeeded: a motion before the first `reset`, or after an episode's end.
        gymnasium.error.DependencyNotInstalled: "human" without pygame.
    """

    # Gymnasium declares this as an instance variable.
    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["human", "rgb_array", "map"],
        "render_fps": 4,
        "actions": ACTION_NAMES,
        "channels": CHANNELS,
    }

    def __init__(
        self,
        task: int | None = None,
        scenario: Scenario | str | Path | None = None,
        render_mode: str | None = None,
        camera: Frames | None = None,
    ) -> None:
        scenario = _resolve(scenario)
        ids = [each.id for each in scenario.tasks]
        task = ids[0] if task is None else task
        if task not in ids:
            raise ConfigurationError(f"task {task} is not in scenario {scenario.name}, expected one of {ids}")
        self.render_mode = render_mode
        self._window = Window(self.metadata["render_fps"]) if render_mode == "human" else None
        self.task_map = task_map(scenario, task)
        self.rewards = task_table(scenario, task)
        self._world, self._discount = world_of(scenario), scenario.learning.discount
        self.camera = self._seen_by = camera or new_camera(scenario)
        self._scenario, self._small = scenario, dict[tuple[int, ...], Frames]()
        self._cell, self._motions, self._is_over = self.task_map.entry, 0, True
        self._walked: list[Cell] = []
        shape = (camera_of(scenario).height, camera_of(scenario).width, len(CHANNELS))
        self._frame: Frame = np.zeros(shape, np.uint8)
        self.observation_space = spaces.Box(0, 255, shape, np.uint8)
        self.action_space = spaces.Discrete(len(ACTIONS))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Frame, Info]:
        if unknown := set(options or ()) - {"start"}:
            raise ConfigurationError(
                f'reset options {sorted(map(str, unknown))} are not known, expected "start" or none'
            )
        super().reset(seed=seed)
        self._cell = self._start((options or {}).get("start", "entry"))
        self._motions, self._is_over, self._walked = 0, False, [self._cell]
        return self.look()

    def look(self) -> tuple[Frame, Info]:
        """Another frame from where the robot stands, as after `reset`."""
        return self._look(), self._info()

    def show_as(self, kept: tuple[int, ...] | None) -> bool:
        """Show frames of shape `kept` from now on, or with None such as the space says; whether it does.

        It does not where `camera.draw` is "frame".
        """
        self._seen_by, size = self.camera, self.observation_space.shape
        if kept is None or kept == size or camera_of(self._scenario).draw == "frame":
            return kept in (None, size)
        if kept not in self._small:
            self._small[kept] = camera_in_use(self._scenario, (kept[1], kept[0]))
        self._seen_by = self._small[kept]
        return True

    def step(self, action: np.int64 | int) -> tuple[Frame, float, bool, bool, Info]:
        if isinstance(action, bool) or not self.action_space.contains(action):
            raise InvalidAction(f"action {action!r}, expected one of the integers 0 to {len(ACTIONS) - 1}")
        if self._is_over:
            raise ResetNeeded("no episode is going on: it has ended or none was begun; expected reset() before step()")
        self._cell = move(self._cell, int(action), self.task_map.rows, self.task_map.cols)
        self._motions += 1
        self._walked.append(self._cell)
        terminated = self._cell == self.task_map.exit
        truncated = not terminated and self._motions >= self._world.max_motions
        self._is_over = terminated or truncated
        return self._look(), float(self.rewards[self._cell]), terminated, truncated, self._info()

    def render(self) -> Frame | None:
        """A picture, uint8 [height, width, 3]; of "rgb_array" a view, valid as long as the frame. None of "human"."""
        if self.render_mode == "map":
            return map_picture(self.task_map, self.rewards, self._walked)
        return self._frame[..., :3] if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        if self._window:
            self._window.close()

    def state(self) -> dict[str, Any]:
        """Where the robot stands, as plain values; what `np_random` will draw and the newest frame are apart."""
        return {"cell": self._cell, "motions": self._motions, "over": self._is_over}

    def load_state(self, state: dict[str, Any]) -> None:
        """Take up what `state` returned."""
        self._cell, self._motions, self._is_over = tuple(state["cell"]), state["motions"], state["over"]
        self._walked = [self._cell]

    def guide(self) -> int:
        """The best action here by the position-reward table."""
        return int(self._best[self._cell])

    def start(self, where: str, share: int, shares: int) -> Sequence[dict[str, Any]]:
        """Options of `reset`: to begin at the entry, anywhere, or in the area of robot `share` of `shares`."""
        if where == "entry":
            return [{"start": self.task_map.entry}]
        area = (0, 1) if where == "anywhere" else (share, shares)
        return [{"start": cell} for cell in start_cells(self.task_map, *area)]

    def judge(self, total: float) -> tuple[float, dict[str, float]]:
        """What an episode that has brought `total` counts, the RMSE of its path in metres, and whether it `reached` the
        exit: 1 or 0.

        Without the exit it never counts above 0 (DESIGN: it counts only with its exit).
        """
        reached = self._cell == self.task_map.exit
        error_m = rmse_m(self._walked, self.task_map, self._world.cell_m)
        return total if reached else min(total, 0.0), {"rmse_m": error_m, "reached": float(reached)}

    @cached_property
    def _best(self) -> npt.NDArray[np.int64]:
        return table_policy(self.rewards, self.task_map, self._discount)

    def _look(self) -> Frame:
        self._frame = self._seen_by.frame(self._cell, self.np_random)
        if self._window:
            seen = map_picture(self.task_map, self.rewards, self._walked)
            self._window.show(side_by_side(self._frame[..., :3], seen))
        return self._frame

    def _info(self) -> Info:
        row, col = self._cell
        cell_m = self._world.cell_m
        return {
            "cell": self._cell,
            "position_m": (row * cell_m, col * cell_m),
            "reached_exit": self._cell == self.task_map.exit,
        }

    def _start(self, start: object) -> Cell:
        if isinstance(start, str) and start == "entry":
            return self.task_map.entry
        if isinstance(start, str) and start == "random":
            cells = start_cells(self.task_map)
            return cells[int(self.np_random.integers(len(cells)))]
        rows, cols = self.task_map.rows, self.task_map.cols
        cell = _integers(start)
        if len(cell) == 2 and 0 <= cell[0] < rows and 0 <= cell[1] < cols and cell != self.task_map.exit:
            return cell[0], cell[1]
        raise ConfigurationError(
            f'start {start!r}: expected "entry", "random" or (row, column) within {rows} x {cols}, not the exit'
        )


def _integers(values: object) -> tuple[int, ...]:
    """Python's or NumPy's integers as Python's own; nothing where there is anything else among them."""
    held = list(values) if isinstance(values, list | tuple | np.ndarray) else []
    fits = all(isinstance(each, int | np.integer) and not isinstance(each, bool) for each in held)
    return tuple(map(int, held)) if fits else ()


def _resolve(scenario: Scenario | str | Path | None) -> Scenario:
    if isinstance(scenario, Scenario):
        return scenario
    return load_scenario(scenario or "paper")
