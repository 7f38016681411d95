"""What a task map means: motions, rewards, the best policy, where to start, how far off the path.

Pure functions. A cell is (row, column); the robot enters at the side of row 0 and faces growing rows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.maps import Cell, TaskMap, neighbouring_cells
from jouleswarm.environments.landmarks.settings import World, task_map, task_rewards, world_of

FORWARD, BACKWARD, LEFT, RIGHT = ACTIONS = range(4)  # row + 1, row - 1, column - 1, column + 1
_SETTLED = 1e-9
_TIE = 1e-6  # equal returns added up in another order differ by rounding


def move(cell: Cell, action: int, rows: int, cols: int) -> Cell:
    """The landmark that `action` leads to; a motion off the grid's edge stays where it is."""
    row, col = neighbouring_cells(cell)[action]
    return (row, col) if 0 <= row < rows and 0 <= col < cols else cell


def reward_table(task_map: TaskMap, world: World, rewards: Sequence[float] | None = None) -> npt.NDArray[np.float32]:
    """Position-reward table: the reward of arriving at each landmark, float32 [rows, cols].

    The path's i-th landmark (of L motions) is worth path_reward - path_slope * (1 - i / L); a landmark d motions
    (Manhattan distance) off the path is worth its nearest path landmark's value + off_path_reward * d, the best of
    several nearest ones. The exit counts there as the path's L-th landmark, without its exit_reward.
    `rewards`, row by row, replace all of this (Task.rewards).
    """
    if rewards is not None:
        return np.array(rewards, np.float32).reshape(task_map.rows, task_map.cols)
    path = np.array(task_map.path)
    along = np.arange(len(path)) / (len(path) - 1)
    values = world.path_reward - world.path_slope * (1 - along)
    cells = np.indices((task_map.rows, task_map.cols)).reshape(2, -1).T
    distances = np.abs(cells[:, None, :] - path[None, :, :]).sum(axis=2)
    nearest = distances.min(axis=1)
    best = np.where(distances == nearest[:, None], values, -np.inf).max(axis=1)
    table = (best + world.off_path_reward * nearest).reshape(task_map.rows, task_map.cols)
    for cell in task_map.obstacles:
        table[cell] = world.obstacle_reward
    table[task_map.exit] = world.exit_reward
    return np.asarray(table, dtype=np.float32)


def task_table(scenario: Scenario, task: int) -> npt.NDArray[np.float32]:
    """The position-reward table of one of the scenario's tasks, float32 [rows, cols]."""
    return reward_table(task_map(scenario, task), world_of(scenario), task_rewards(scenario, task))


def action_values(
    table: npt.NDArray[np.float32], task_map: TaskMap, discount: float, max_sweeps: int = 10_000
) -> npt.NDArray[np.float64]:
    """Best discounted return of each action at each landmark, float64 [actions, rows, cols]; 0 at the exit.

    Value iteration on the known table; `max_sweeps` bounds the horizon where discount = 1 has no finite answer.
    """
    following = _following(task_map)
    rewards = table.ravel().astype(np.float64)[following]
    exit_ = task_map.exit[0] * task_map.cols + task_map.exit[1]
    rewards[:, exit_] = 0.0
    following[:, exit_] = exit_
    values = np.zeros(table.size)
    for _ in range(max_sweeps):
        update = (rewards + discount * values[following]).max(axis=0)
        change = np.abs(update - values).max()
        values = update
        if change < _SETTLED:
            break
    return np.asarray(rewards + discount * values[following]).reshape(len(ACTIONS), *table.shape)


def table_policy(table: npt.NDArray[np.float32], task_map: TaskMap, discount: float = 0.99) -> npt.NDArray[np.int64]:
    """The optimal action at each landmark when the table is known, int64 [rows, cols].

    Of equally good actions the first in the order F, B, L, R. The exit ends an episode, an obstacle only costs.
    """
    values = action_values(table, task_map, discount)
    return np.asarray((values >= values.max(axis=0) - _TIE).argmax(axis=0), dtype=np.int64)


def rmse_m(walked: Sequence[Cell], task_map: TaskMap, cell_m: float) -> float:
    """Time-aligned RMSE in metres of the landmarks `walked` (the start first) against the assigned path.

    After motion h the robot is compared with the path's h-th landmark; the shorter of the two waits at its end.
    """
    path = task_map.path
    length = max(len(walked), len(path))
    ours = np.array([walked[min(h, len(walked) - 1)] for h in range(length)])
    assigned = np.array([path[min(h, len(path) - 1)] for h in range(length)])
    return float(cell_m * np.sqrt(((ours - assigned) ** 2).sum(axis=1).mean()))


def start_cells(task_map: TaskMap, share: int = 0, shares: int = 1) -> tuple[Cell, ...]:
    """Landmarks where learning episodes of robot `share` (from 0) of `shares` start: its own area.

    All landmarks but the exit and obstacles, row by row, cut into near-equal runs. More robots than landmarks
    share one landmark each.

    Raises:
        ConfigurationError: `share` is not below `shares`.
    """
    if not 0 <= share < shares:
        raise ConfigurationError(f"area {share} of {shares}: expected 0 to {shares - 1}")
    taken = {task_map.exit, *task_map.obstacles}
    cells = [(r, c) for r in range(task_map.rows) for c in range(task_map.cols) if (r, c) not in taken]
    if shares > len(cells):
        return (cells[share % len(cells)],)
    return tuple(cells[share * len(cells) // shares : (share + 1) * len(cells) // shares])


def _following(task_map: TaskMap) -> npt.NDArray[np.int64]:
    """Row-by-row index of the landmark that each action leads to, int64 [actions, cells]."""
    rows, cols = task_map.rows, task_map.cols
    moves = [[move((r, c), action, rows, cols) for r in range(rows) for c in range(cols)] for action in ACTIONS]
    return np.asarray(np.array(moves) @ np.array([cols, 1]), dtype=np.int64)
