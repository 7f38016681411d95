"""Camera frames as the network sees them."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt


def resize(frame: npt.NDArray[np.uint8], width: int, height: int) -> npt.NDArray[np.uint8]:
    """A frame, uint8 [H, W, 4], scaled to uint8 [height, width, 4] by area averaging, channels last as in replay."""
    return np.asarray(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
