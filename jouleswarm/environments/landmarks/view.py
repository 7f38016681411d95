"""The grid from above: the path to follow, what a landmark is worth, and the way that was walked."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from jouleswarm.environments.landmarks.maps import Cell, TaskMap

Picture = npt.NDArray[np.uint8]

LANDMARK = 48  # pixels a side
_FLOOR, _PATH, _WALK, _ROBOT = (236, 236, 236), (120, 120, 120), (0, 114, 178), (213, 94, 0)
_ENTRY, _EXIT, _OBSTACLE, _LINES = (86, 180, 233), (0, 158, 115), (40, 40, 40), (255, 255, 255)


def map_picture(task_map: TaskMap, rewards: npt.NDArray[np.float32], walked: Sequence[Cell]) -> Picture:
    """The grid from above, row 0 at the top: uint8 [rows * 48, cols * 48, 3], red, green, blue.

    Entry light blue, exit green, obstacles black, other landmarks the darker the less their reward
    (float32 [rows, cols]); the path to follow is the grey line, the way walked the blue one, the robot the
    orange disc at its end.
    """
    picture = np.empty((task_map.rows * LANDMARK, task_map.cols * LANDMARK, 3), np.uint8)
    for cell, shade in np.ndenumerate(_shades(task_map, rewards)):
        row, col = cell
        colour = _marked(task_map, (row, col)) or tuple(int(shade * each) for each in _FLOOR)
        corner = col * LANDMARK, row * LANDMARK
        cv2.rectangle(picture, corner, (corner[0] + LANDMARK - 1, corner[1] + LANDMARK - 1), colour, cv2.FILLED)
        cv2.rectangle(picture, corner, (corner[0] + LANDMARK - 1, corner[1] + LANDMARK - 1), _LINES, 1)
    _line(picture, task_map.path, _PATH, LANDMARK // 6)
    _line(picture, walked, _WALK, LANDMARK // 12)
    for cell in walked[-1:]:
        cv2.circle(picture, _middle(cell), LANDMARK // 4, _ROBOT, cv2.FILLED, cv2.LINE_AA)
    return picture


def side_by_side(left: Picture, right: Picture) -> Picture:
    """Two pictures at the left one's height, uint8 [height, width, 3]."""
    height = max(left.shape[0], right.shape[0])
    return np.hstack([_at_height(left, height), _at_height(right, height)])


def _at_height(picture: Picture, height: int) -> Picture:
    width = max(1, round(picture.shape[1] * height / picture.shape[0]))
    return np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)


def _shades(task_map: TaskMap, rewards: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """From 0.7, the least reward of a plain landmark, to 1, the largest."""
    plain = np.ones(rewards.shape, bool)
    for cell in (task_map.exit, *task_map.obstacles):
        plain[cell] = False
    low, high = rewards[plain].min(), rewards[plain].max()
    return np.asarray(0.7 + 0.3 * np.clip((rewards - low) / max(high - low, 1e-9), 0, 1), np.float64)


def _marked(task_map: TaskMap, cell: Cell) -> tuple[int, int, int] | None:
    if cell in task_map.obstacles:
        return _OBSTACLE
    return {task_map.entry: _ENTRY, task_map.exit: _EXIT}.get(cell)


def _middle(cell: Cell) -> tuple[int, int]:
    row, col = cell
    return col * LANDMARK + LANDMARK // 2, row * LANDMARK + LANDMARK // 2


def _line(picture: Picture, cells: Sequence[Cell], colour: tuple[int, int, int], width: int) -> None:
    cv2.polylines(picture, [np.array([_middle(cell) for cell in cells], np.int32)], False, colour, width, cv2.LINE_AA)
