"""The robot's two cameras: where it stands -> one RGB-D frame.

Drawing the world is too slow to do for every frame. So each landmark is drawn from a few poses when it is first
seen, at half resolution and a little wider than a frame, and a frame is an enlarged cut of one of these views
plus sensor noise: where the cut lies is the robot's heading and tilt, which view it is from is its position.
40 landmarks take 40 x 3 x 0.33 MB = 39 MB at 640 x 480.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.scene import Scene, build_scene, cast
from jouleswarm.environments.landmarks.settings import Camera as CameraSettings
from jouleswarm.environments.landmarks.settings import World

Frame = npt.NDArray[np.uint8]

_POSES = 3  # views a landmark
_SCALE = 2  # frame pixels a view pixel
_NOISE_SPAN = 1 << 16  # a frame's noise starts at one of so many places of the noise tape
_SEED = 445


class Camera:
    """Frames of one world. Keeps its views to itself: use one camera a thread."""

    def __init__(self, world: World, settings: CameraSettings, obstacles: frozenset[Cell] = frozenset()) -> None:
        self._cell_m, self._settings = world.cell_m, settings
        self._scene: Scene = build_scene(world.rows, world.cols, obstacles)
        self._views: dict[Cell, list[Frame]] = {}
        focal = settings.width / 2 / _SCALE  # 90 degrees across
        self._focal = focal
        self._margin = math.ceil(focal * math.tan(math.radians(settings.heading_jitter_deg)))
        self._size = (math.ceil(settings.width / _SCALE), math.ceil(settings.height / _SCALE))
        samples = settings.width * settings.height * 4 + _NOISE_SPAN
        tape = np.random.default_rng(_SEED).standard_normal(samples, dtype=np.float32)
        tape = np.clip(np.rint(tape * settings.noise), -255, 255)
        self._brighter, self._darker = np.maximum(tape, 0).astype(np.uint8), np.maximum(-tape, 0).astype(np.uint8)

    def frame(self, cell: Cell, rng: np.random.Generator) -> Frame:
        """What the robot at `cell` sees, facing growing rows: uint8 [height, width, 4], an array of its own.

        Channels: red, green, blue, and the distance along the camera's axis as 255 * distance / range_m, where 255 is
        range_m or more, before noise. Position and heading are uniform within the settings' jitter of the landmark
        and of growing rows, the tilt within half the heading's. The same settings, cell and state of `rng` give
        the same frame.
        """
        if cell not in self._views:
            self._views[cell] = self._draw(cell)
        views = self._views[cell]
        pose, dx, dy, at = rng.integers((len(views), 2 * self._margin + 1, self._margin + 1, _NOISE_SPAN))
        width, height = self._size
        cut = views[pose][dy : dy + height, dx : dx + width]
        settings = self._settings
        frame = cv2.resize(cut, (settings.width, settings.height), interpolation=cv2.INTER_LINEAR)
        if settings.noise:
            noise = slice(at, at + frame.size)
            flat = frame.reshape(-1)
            cv2.add(flat, self._brighter[noise], dst=flat)
            cv2.subtract(flat, self._darker[noise], dst=flat)
        return np.asarray(frame, dtype=np.uint8)

    def _draw(self, cell: Cell) -> list[Frame]:
        """The views of a landmark, uint8 [height, width, 4] each, from poses that only its place decides."""
        jitter = self._settings.pose_jitter_m / self._cell_m
        rng = np.random.default_rng([_SEED, *cell])
        poses = rng.uniform(-jitter, jitter, (_POSES if jitter else 1, 2)) + np.array([cell[1], cell[0]])
        width, height = self._size[0] + 2 * self._margin, self._size[1] + self._margin
        views = []
        for x, y in poses.tolist():
            picture, depth = cast(self._scene, x, y, width, height, self._focal)
            grey = np.minimum(np.rint(depth * (255 * self._cell_m / self._settings.range_m)), 255)
            views.append(np.dstack([picture, grey.astype(np.uint8)]))
        return views
