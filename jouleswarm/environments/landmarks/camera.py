"""The robot's two cameras: where it stands -> one RGB-D frame.

Drawing the world is too slow to do for every frame. So each landmark is drawn from a few poses when it is first
seen, at half resolution and a little wider than a frame, and a frame is an enlarged cut of one of these views
plus sensor noise: where the cut lies is the robot's heading and tilt, which view it is from is its position.
40 landmarks take 40 x 3 x 0.33 MB = 39 MB at 640 x 480.
"""

from __future__ import annotations

import cv2
import numpy as np

from jouleswarm.environments.landmarks.drawing import Frame, Noise, views_of
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.settings import Camera as CameraSettings
from jouleswarm.environments.landmarks.settings import World


class Camera:
    """Frames of one world. Its views are shared by all cameras like it in a process."""

    def __init__(self, world: World, settings: CameraSettings, obstacles: frozenset[Cell] = frozenset()) -> None:
        self.views = views_of(world, settings, obstacles)
        self._frame = settings.width, settings.height
        self._noise = Noise(settings.noise, settings.width * settings.height * 4)

    def frame(self, cell: Cell, rng: np.random.Generator) -> Frame:
        """What the robot at `cell` sees, facing growing rows: uint8 [height, width, 4], an array of its own.

        Channels: red, green, blue, and the distance along the camera's axis as 255 * distance / range_m, where 255 is
        range_m or more, before noise. Position and heading are uniform within the settings' jitter of the landmark
        and of growing rows, the tilt within half the heading's. The same settings, cell and state of `rng` give
        the same frame.
        """
        cut, at = self.views.cut(cell, rng)
        frame = np.asarray(cv2.resize(cut, self._frame, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
        self._noise.add(frame, at)
        return frame
