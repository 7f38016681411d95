"""The same cameras at the size that a network looks at, drawn so at once (`camera.draw = "input"`).

Drawing a frame of 640 x 480 and shrinking it to 48 x 36 takes many times as long as shrinking a view of four pixels for
each pixel of the frame, along each axis. What is seen is the same but for rounding, and the noise is what averaging
leaves of it. The two are not the same to the bit.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from jouleswarm.environments.landmarks.drawing import SCALE, Frame, Noise, views_of
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.settings import Camera as CameraSettings
from jouleswarm.environments.landmarks.settings import World

_FINER = 4  # view pixels a frame pixel along each axis, at most


class SmallCamera:
    """Frames of one world, of `size` (width, height). Its views are shared by all cameras like it in a process."""

    def __init__(
        self, world: World, settings: CameraSettings, obstacles: frozenset[Cell], size: tuple[int, int]
    ) -> None:
        finer = min(_FINER, max(1, settings.width // (SCALE * size[0])))  # whole numbers shrink fastest
        width = SCALE * finer * size[0]
        height = max(1, round(width * settings.height / settings.width))
        self.views = views_of(world, settings.model_copy(update={"width": width, "height": height}), obstacles)
        self._frame = size
        averaged = max(1.0, settings.width * settings.height / (size[0] * size[1]))
        self._noise = Noise(settings.noise / math.sqrt(averaged), size[0] * size[1] * 4)

    def frame(self, cell: Cell, rng: np.random.Generator) -> Frame:
        """As of `camera.Camera`, uint8 [size[1], size[0], 4]."""
        cut, at = self.views.cut(cell, rng)
        frame = np.asarray(cv2.resize(cut, self._frame, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        self._noise.add(frame, at)
        return frame
