"""What the robots' world looks like, and a ray caster that draws it. Lengths are in cells, x along a row.

All robots move in one place, so the look depends on the grid alone, never on a task.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from common.maps import Cell

Picture = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]

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
    """A hall with patterned floor and ceiling, a two-coloured post ahead of each landmark, obstacles as barrels."""
    rng = np.random.default_rng(_LOOK_SEED)
    length, breadth = rows - 1 + 2 * BORDER, cols - 1 + 2 * BORDER
    posts = [_post(r, c, r * cols + c) for r in range(rows) for c in range(cols)]
    barrels = [Pillar(c, r, 0.3, 0.5, ((0.15, 0.15, 0.17), (0.9, 0.75, 0.1))) for r, c in sorted(obstacles)]
    return Scene(
        rows,
        cols,
        floor=_patches(rng, length, breadth, (30, 210)),
        ceiling=_patches(rng, length, breadth, (110, 250)),
        walls=np.hstack(
            [
                _wall(rng, length, hues=(0.0, 0.14), panel=0.7),
                _wall(rng, length, hues=(0.5, 0.7), panel=0.9),
                _wall(rng, breadth, hues=(0.2, 0.45), panel=0.9),
            ]
        ),
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


def _post(row: int, col: int, number: int) -> Pillar:
    """Colours step through the hues by the golden ratio, so that posts near each other differ."""
    lower = colorsys.hsv_to_rgb(number * 0.618 % 1, 0.9, 0.95)
    upper = colorsys.hsv_to_rgb(number * 0.382 % 1, 0.55, 0.9)
    return Pillar(col + 0.35, row + 0.7, 0.12, 0.5, (lower, upper))


def _patches(rng: np.random.Generator, length: float, breadth: float, levels: tuple[int, int]) -> Picture:
    """Soft patches of colour as large as a cell, speckle, and seams twice a cell."""
    height, width = round(length * _TEXELS), round(breadth * _TEXELS)
    patches = rng.uniform(*levels, (round(length) + 2, round(breadth) + 2, 3)).astype(np.float32)
    surface = cv2.resize(patches, (width, height), interpolation=cv2.INTER_CUBIC)
    surface = surface + rng.normal(0, 6, (height, width, 1))
    surface[:: _TEXELS // 2] *= 0.8
    surface[:, :: _TEXELS // 2] *= 0.8
    return np.clip(surface, 0, 255).astype(np.uint8)


def _wall(rng: np.random.Generator, length: float, hues: tuple[float, float], panel: float) -> Picture:
    """Panels `panel` cells wide, each of a colour between two hues, with a dark skirting."""
    count = round(length / panel) + 1
    colours = [
        colorsys.hsv_to_rgb(rng.uniform(*hues), rng.uniform(0.3, 0.8), rng.uniform(0.5, 1)) for _ in range(count)
    ]
    row = np.repeat((np.array(colours) * 255).astype(np.uint8), round(panel * _TEXELS), axis=0)
    wall = np.tile(row[None, : round(length * _TEXELS)], (round(WALL_HEIGHT * _TEXELS), 1, 1))
    wall[-5:] = 50
    return wall
