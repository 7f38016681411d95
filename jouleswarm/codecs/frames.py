"""Observations as the network sees them: images shrunk, everything else as it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from jouleswarm.common.scenario.spaces import Observation


def shrink(observation: npt.NDArray[Any], kept: Observation) -> npt.NDArray[Any]:
    """An observation as a replay memory keeps it: an image scaled to `kept.shape` by area averaging.

    Pixels stay channels last. What has the shape already is returned itself.
    """
    return observation if observation.shape == kept.shape else resize(observation, kept.shape[1], kept.shape[0])


def resize(frame: npt.NDArray[np.uint8], width: int, height: int) -> npt.NDArray[np.uint8]:
    """A frame, uint8 [H, W, channels], scaled to uint8 [height, width, channels] by area averaging."""
    import cv2  # nobody else who reads a scenario needs OpenCV

    scaled = cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(scaled, dtype=np.uint8).reshape(height, width, frame.shape[2])
