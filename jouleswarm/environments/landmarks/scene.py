"""What the robots' world looks like, and a ray caster that draws it. Lengths are in cells, x along a row.

All robots move in one place, so the look depends on the grid alone, never on a task.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from jouleswarm.environments.landmarks.maps import Cell

Picture = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Colouring = Callable[[npt.NDArray[Any], npt.NDArray[Any]], tuple[Any, Any, Any]]

CAMERA_HEIGHT = 0.3
WALL_HEIGHT = 1.2
BORDER = 1.0  # from the outermost landmarks to the walls
_TEXELS = 48  # texture pixels a cell
_LOOK_SEED = 2212  # one world for all runs: a robot may be moved from run to run


@dataclass(frozen=True)
class Pillar:
    """An upright cylinder in two colours, the second above the first."""

    x: float
    y: float
    radius: float
    height: float
    colours: tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Scene:
    """Textures, uint8 [height, width, 3], and pillars; the origin is landmark (0, 0)."""

    rows: int
    cols: int
    floor: Picture
    ceiling: Picture
    walls: Picture  # left, right and front side by side; the one behind is never seen
    pillars: tuple[Pillar, ...]


def build_scene(rows: int, cols: int, obstacles: frozenset[Cell]) -> Scene:
    """A hall with tiled surfaces, a two-coloured post ahead of each landmark, obstacles as barrels.

    Colours change steadily along rows and columns: landmarks close by look alike, far ones do not, and what a
    network learns of one helps with the next. With colours at random, learning took two to three times the rounds.
    """
    rng = np.random.default_rng(_LOOK_SEED)
    length, breadth = rows - 1 + 2 * BORDER, cols - 1 + 2 * BORDER
    walls = (
        _surface(rng, WALL_HEIGHT, length, lambda down, along: (0.9, 0.2 + 0.6 * along, 0.1)),
        _surface(rng, WALL_HEIGHT, length, lambda down, along: (0.1, 0.2 + 0.6 * along, 0.9)),
        _surface(rng, WALL_HEIGHT, breadth, lambda down, along: (0.3, 0.9, 0.1 + 0.8 * along)),
    )
    posts = [_post(r, c, rows, cols) for r in range(rows) for c in range(cols)]
    barrels = [Pillar(c, r, 0.3, 0.5, ((0.15, 0.15, 0.17), (0.9, 0.75, 0.1))) for r, c in sorted(obstacles)]
    return Scene(
        rows,
        cols,
        floor=_surface(rng, length, breadth, lambda ahead, across: (ahead, 0.15, across)),
        ceiling=_surface(rng, length, breadth, lambda ahead, across: (1 - ahead, 0.2, 1 - across)),
        walls=np.hstack(walls),
        pillars=(*posts, *barrels),
    )


def cast(scene: Scene, x: float, y: float, width: int, height: int, focal: float) -> tuple[Picture, Floats]:
    """The view from (x, y) facing growing y: RGB uint8 [height, width, 3] and depth float32 [height, width].

    A pinhole camera with `focal` pixels; depth is measured along its axis, in cells.
    """
    across = ((np.arange(width) + 0.5 - width / 2) / focal).astype(np.float32)
    down = ((np.arange(height) + 0.5 - height / 2) / focal).astype(np.float32)
    ahead = scene.rows - 1 + BORDER - y
    with np.errstate(divide="ignore"):
        side = np.where(across < 0, (-BORDER - x) / across, (scene.cols - 1 + BORDER - x) / across)
        level = np.where(down > 0, CAMERA_HEIGHT, WALL_HEIGHT - CAMERA_HEIGHT).astype(np.float32) / np.abs(down)
    wall = np.minimum(side, ahead)
    depth = np.minimum(wall[None, :], level[:, None])
    picture = _shade(_backdrop(scene, x, y, across, down, wall, ahead, depth), depth)
    for pillar in sorted(scene.pillars, key=lambda each: -each.y):
        _draw(picture, depth, pillar, pillar.x - x, pillar.y - y, across, down)
    return picture, depth


def _backdrop(
    scene: Scene, x: float, y: float, across: Floats, down: Floats, wall: Floats, ahead: float, depth: Floats
) -> Picture:
    """Colours of walls, floor and ceiling, uint8 [height, width, 3]."""
    at_x, at_y = x + across * depth + BORDER, y + depth + BORDER
    up = WALL_HEIGHT - (CAMERA_HEIGHT - down[:, None] * depth)
    length, is_front = scene.rows - 1 + 2 * BORDER, wall >= ahead
    along = np.where(is_front, 2 * length + at_x, np.where(across < 0, at_y, length + at_y))
    picture = np.empty((*depth.shape, 3), np.uint8)
    below, is_wall = down > 0, depth == wall[None, :]
    for texture, rows in ((scene.floor, below), (scene.ceiling, ~below)):
        picture[rows] = _texel(texture, at_y[rows], at_x[rows])
    picture[is_wall] = _texel(scene.walls, up[is_wall], along[is_wall])
    return picture


def _draw(picture: Picture, depth: Floats, pillar: Pillar, dx: float, dy: float, across: Floats, down: Floats) -> None:
    """Draw a pillar at (dx, dy) from the camera over everything behind it."""
    if dx * dx + dy * dy <= pillar.radius**2:
        return  # inside it
    # |t (across, 1) - (dx, dy)|^2 = radius^2, the nearer solution
    a = across * across + 1
    b = across * dx + dy
    c = dx * dx + dy * dy - pillar.radius**2
    (columns,) = np.nonzero((b > 0) & (b * b > a * c))
    if not len(columns):
        return
    a, b = a[columns], b[columns]
    root = np.sqrt(b * b - a * c)
    t = (b - root) / a
    top, bottom = np.searchsorted(down, [(CAMERA_HEIGHT - pillar.height) / t.min(), CAMERA_HEIGHT / t.min()])
    view = slice(top, bottom), slice(columns[0], columns[-1] + 1)
    z = CAMERA_HEIGHT - down[view[0], None] * t[None, :]
    hit = (z >= 0) & (z <= pillar.height) & (t[None, :] < depth[view])
    facing = root / (np.sqrt(a) * pillar.radius)  # cosine between the ray and the surface
    light = _fog(t) * (0.45 + 0.55 * facing)
    low, high = (np.array(colour, np.float32) * 255 for colour in pillar.colours)
    colour = np.where((z > pillar.height / 2)[..., None], high, low) * light[None, :, None]
    picture[view][hit] = colour[hit].astype(np.uint8)
    depth[view][hit] = np.broadcast_to(t, z.shape)[hit]


def _fog(distance: Floats) -> Floats:
    return np.asarray(1 / (1 + 0.06 * distance), dtype=np.float32)


def _shade(picture: Picture, depth: Floats) -> Picture:
    return np.asarray(picture * _fog(depth)[..., None], dtype=np.uint8)


def _texel(texture: Picture, row: Floats, col: Floats) -> Picture:
    rows = np.clip(row * _TEXELS, 0, texture.shape[0] - 1).astype(np.intp)
    cols = np.clip(col * _TEXELS, 0, texture.shape[1] - 1).astype(np.intp)
    return texture[rows, cols]


def _post(row: int, col: int, rows: int, cols: int) -> Pillar:
    """The lower half's hue tells the column, the upper half's the row; 0.8 of the circle, so that no two ends meet."""
    lower, upper = (
        colorsys.hsv_to_rgb(0.8 * share, 0.95, 1) for share in (col / max(1, cols - 1), row / max(1, rows - 1))
    )
    return Pillar(col + 0.35, row + 0.7, 0.2, 0.6, (lower, upper))


def _surface(rng: np.random.Generator, height: float, width: float, colour: Colouring) -> Picture:
    """Tiles of half a cell with a little speckle, coloured by where they are: down and across, 0 to 1."""
    shape = round(height * _TEXELS), round(width * _TEXELS)
    down, across = np.linspace(0, 1, shape[0])[:, None], np.linspace(0, 1, shape[1])[None, :]
    surface = np.dstack([np.broadcast_to(channel, shape) for channel in colour(down, across)]) * 255
    surface += rng.normal(0, 6, (*shape, 1))
    surface[:: _TEXELS // 2] *= 0.8
    surface[:, :: _TEXELS // 2] *= 0.8
    return np.asarray(np.clip(surface, 0, 255), dtype=np.uint8)
