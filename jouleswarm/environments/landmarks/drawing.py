"""What cameras of the drawn world share: views of a landmark, of which frames are cut, and sensor noise."""

from __future__ import annotations

import math
import threading
from weakref import WeakValueDictionary

import cv2
import numpy as np
import numpy.typing as npt

from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.scene import Scene, build_scene, cast
from jouleswarm.environments.landmarks.settings import Camera, World

Frame = npt.NDArray[np.uint8]

SCALE = 2  # frame pixels a view pixel
NOISE_SPAN = 1 << 16  # a frame's noise starts at one of so many places of the noise tape
_POSES = 3  # views a landmark
_SEED = 445


class Views:
    """A world seen from its landmarks, at half a frame's resolution and a little wider than a frame.

    A landmark is drawn when it is first seen, by whichever thread sees it; get them from `views_of`.
    """

    def __init__(self, world: World, settings: Camera, obstacles: frozenset[Cell]) -> None:
        self._drawn, self._lock = dict[Cell, list[Frame]](), threading.Lock()
        self._cell_m, self._settings = world.cell_m, settings
        self._scene: Scene = build_scene(world.rows, world.cols, obstacles)
        self._focal = settings.width / 2 / SCALE  # 90 degrees across
        self._margin = math.ceil(self._focal * math.tan(math.radians(settings.heading_jitter_deg)))
        self._size = (math.ceil(settings.width / SCALE), math.ceil(settings.height / SCALE))  # of a cut

    def cut(self, cell: Cell, rng: np.random.Generator) -> tuple[Frame, int]:
        """The part of one of a landmark's views that a robot sees now, read-only; and where its noise starts."""
        views = self.of(cell)
        pose, dx, dy, at = rng.integers((len(views), 2 * self._margin + 1, self._margin + 1, NOISE_SPAN))
        width, height = self._size
        return views[pose][dy : dy + height, dx : dx + width], int(at)

    def of(self, cell: Cell) -> list[Frame]:
        """A landmark's views, uint8 [height, width, 4] each, from poses that only its place decides; read-only."""
        if cell not in self._drawn:
            with self._lock:
                if cell not in self._drawn:
                    self._drawn[cell] = self._draw(cell)
        return self._drawn[cell]

    def _draw(self, cell: Cell) -> list[Frame]:
        jitter = self._settings.pose_jitter_m / self._cell_m
        rng = np.random.default_rng([_SEED, *cell])
        poses = rng.uniform(-jitter, jitter, (_POSES if jitter else 1, 2)) + np.array([cell[1], cell[0]])
        width, height = self._size[0] + 2 * self._margin, self._size[1] + self._margin
        views = []
        for x, y in poses.tolist():
            picture, depth = cast(self._scene, x, y, width, height, self._focal)
            grey = np.minimum(np.rint(depth * (255 * self._cell_m / self._settings.range_m)), 255)
            views.append(np.dstack([picture, grey.astype(np.uint8)]))
            views[-1].flags.writeable = False
        return views


_in_use: WeakValueDictionary[object, Views] = WeakValueDictionary()
_in_use_lock = threading.Lock()


def views_of(world: World, settings: Camera, obstacles: frozenset[Cell]) -> Views:
    """Shared by all cameras of this process and of these settings: to draw a landmark takes as long as many frames."""
    key = world, settings, obstacles
    with _in_use_lock:
        if (found := _in_use.get(key)) is None:
            found = _in_use[key] = Views(*key)
        return found


class Noise:
    """Sensor noise for frames of so many values; equal for equal settings."""

    def __init__(self, deviation: float, values: int) -> None:
        """`deviation`: standard deviation, grey levels."""
        self._deviation = deviation
        tape = np.random.default_rng(_SEED).standard_normal(values + NOISE_SPAN, dtype=np.float32)
        tape = np.clip(np.rint(tape * deviation), -255, 255)
        self._brighter, self._darker = np.maximum(tape, 0).astype(np.uint8), np.maximum(-tape, 0).astype(np.uint8)

    def add(self, frame: Frame, at: int) -> None:
        """Add it in place, from one of NOISE_SPAN places of the tape."""
        if self._deviation:
            noise = slice(at, at + frame.size)
            flat = frame.reshape(-1)
            cv2.add(flat, self._brighter[noise], dst=flat)
            cv2.subtract(flat, self._darker[noise], dst=flat)
