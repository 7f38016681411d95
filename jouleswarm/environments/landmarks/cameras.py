"""Which camera a scenario's robots look through: a drawn world or recorded pictures; shared where it can be."""

from __future__ import annotations

import threading
from itertools import product
from pathlib import Path
from typing import Protocol
from weakref import WeakValueDictionary

import numpy as np
import numpy.typing as npt

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.camera import Camera
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.pictures import missing
from jouleswarm.environments.landmarks.recorded import RecordedCamera
from jouleswarm.environments.landmarks.settings import camera_of, shared_obstacles, world_of
from jouleswarm.environments.landmarks.small import SmallCamera

Frame = npt.NDArray[np.uint8]
Size = tuple[int, int]
"""Width, height."""


class Frames(Protocol):
    """Where frames come from; may be shared between environments of one thread."""

    def frame(self, cell: Cell, rng: np.random.Generator) -> Frame:
        """What the robot at `cell` sees: uint8 [height, width, 4], an array of its own."""


_MOST_AHEAD = 50_000_000
"""Landmarks x pixels of a frame: some five seconds of drawing, 150 MB."""


class _InUse(threading.local):
    def __init__(self) -> None:
        self.cameras: WeakValueDictionary[object, Frames] = WeakValueDictionary()


_in_use = _InUse()


def new_camera(scenario: Scenario, size: Size | None = None) -> Frames:
    """The camera that a scenario asks for; its frames are of `size`, where given."""
    world, settings = world_of(scenario), camera_of(scenario)
    if settings.frames is not None:
        if lacks := next(missing(Path(settings.frames), world.rows, world.cols), None):
            raise ConfigurationError(lacks)
        shown = settings.model_copy(update={"width": size[0], "height": size[1]}) if size else settings
        return RecordedCamera(shown, Path(settings.frames))
    if size is not None:
        return SmallCamera(world, settings, shared_obstacles(scenario), size)
    return Camera(world, settings, shared_obstacles(scenario))


def drawn_cameras(scenario: Scenario) -> list[Frames]:
    """Those that a scenario's robots need, with all landmarks drawn, for who holds them and is forked then.

    None of recorded pictures, nor of so large a world that drawing would take many seconds before the first robot
    begins: there each draws what it sees.
    """
    world, settings = world_of(scenario), camera_of(scenario)
    if settings.frames is not None or world.rows * world.cols * settings.width * settings.height > _MOST_AHEAD:
        return []
    kept = scenario.spaces.observation.kept(scenario.network).shape
    small = (kept[1], kept[0]) if settings.draw == "input" else None
    sizes = {small, None} if scenario.experience_methods else {small}
    cameras = [camera_in_use(scenario, size) for size in sizes]
    for camera, row, col in product(cameras, range(world.rows), range(world.cols)):
        assert isinstance(camera, Camera | SmallCamera)
        camera.views.of((row, col))
    return cameras


def camera_in_use(scenario: Scenario, size: Size | None = None) -> Frames:
    """A camera of this thread that another environment of the same world looks through, else a new one: its views
    take much memory, and two of the same settings see the same."""
    key = world_of(scenario), camera_of(scenario), shared_obstacles(scenario), size
    if (found := _in_use.cameras.get(key)) is None:
        found = _in_use.cameras[key] = new_camera(scenario, size)
    return found
