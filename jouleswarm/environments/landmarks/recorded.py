"""Frames from a user's own pictures, in place of drawn ones (`camera.frames`; see landmarks/pictures.py).

A landmark has one picture or more, and each is as likely to be seen. They may be of any size: they are shrunk to the
camera's. A distance of 0, and one that is not finite, was not measured: it is taken for one out of range.
"""

from __future__ import annotations

import zipfile
from collections import OrderedDict
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.pictures import depth_of, pictures
from jouleswarm.environments.landmarks.settings import Camera

Frame = npt.NDArray[np.uint8]

_HELD_BYTES = 64 * 2**20  # of pictures that have been read


class RecordedCamera:
    """Frames of one folder. Keeps what it has read to itself: use one a thread."""

    def __init__(self, settings: Camera, folder: Path) -> None:
        self._settings, self._folder = settings, folder
        self._pictures: dict[Cell, list[Path]] = {}
        self._read: OrderedDict[Path, Frame] = OrderedDict()
        self._most = max(1, _HELD_BYTES // (4 * settings.width * settings.height))

    def frame(self, cell: Cell, rng: np.random.Generator) -> Frame:
        """One of the frames recorded at `cell`: uint8 [height, width, 4], an array of its own.

        Channels as of `camera.Camera`; nothing is added to what was recorded, no noise and no jitter. The same folder,
        cell and state of `rng` give the same frame.

        Raises:
            ConfigurationError: a picture or its depth cannot be read.
        """
        if cell not in self._pictures:
            self._pictures[cell] = pictures(self._folder, cell)
        held = self._pictures[cell]
        path = held[int(rng.integers(len(held)))]
        if path not in self._read:
            self._read[path] = read_frame(path, self._settings)
            if len(self._read) > self._most:
                self._read.popitem(last=False)
        self._read.move_to_end(path)
        return self._read[path].copy()


def read_frame(picture: Path, settings: Camera) -> Frame:
    """A picture and its depth as a frame of the camera's size, uint8 [height, width, 4].

    Raises:
        ConfigurationError: one of them is none; the line names the file.
    """
    colours = cv2.imread(str(picture), cv2.IMREAD_COLOR)
    if colours is None:
        raise ConfigurationError(f"camera.frames: {picture} is no picture that can be read")
    grey = np.minimum(np.rint(_metres(picture) * (255 / settings.range_m)), 255).astype(np.uint8)
    resized = partial(cv2.resize, dsize=(settings.width, settings.height), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(np.dstack([resized(colours[..., ::-1]), resized(grey)]), dtype=np.uint8)


def _metres(picture: Path) -> npt.NDArray[np.float64]:
    """Distances, float64 [height, width]; infinite where none was measured."""
    path = depth_of(picture)
    if path is None:
        raise ConfigurationError(f"camera.frames: {picture} has no depth beside it")
    if path.suffix == ".npz":
        try:
            with np.load(path, allow_pickle=False) as held:
                metres = np.asarray(held["depth"], np.float64)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise ConfigurationError(f"camera.frames: {path}: {error}; expected an array named depth") from error
    else:
        read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if read is None or read.dtype != np.uint16:
            kind = "no PNG" if read is None else str(read.dtype)
            raise ConfigurationError(f"camera.frames: {path} is {kind}, expected 16 bit, millimetres")
        metres = read.astype(np.float64) / 1000
    if metres.ndim != 2:
        raise ConfigurationError(f"camera.frames: {path} has shape {metres.shape}, expected (height, width)")
    return np.where(np.isfinite(metres) & (metres > 0), metres, np.inf)
