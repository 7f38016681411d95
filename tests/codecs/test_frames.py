"""Frames as the network sees them."""

import numpy as np
import pytest

from jouleswarm.codecs.frames import resize


@pytest.mark.parametrize(("width", "height"), [(96, 72), (48, 36), (640, 480)])
def test_shape_and_dtype(width: int, height: int) -> None:
    resized = resize(np.zeros((480, 640, 4), np.uint8), width, height)
    assert (resized.shape, resized.dtype) == ((height, width, 4), np.uint8)


def test_every_pixel_is_the_mean_of_its_area_and_channel() -> None:
    frame = np.zeros((2, 4, 4), np.uint8)
    frame[:, :2, 0] = [[10, 20], [30, 40]]
    frame[:, 2:, 3] = [[100, 100], [200, 200]]
    assert resize(frame, 2, 1).tolist() == [[[25, 0, 0, 0], [0, 0, 0, 150]]]


def test_areas_that_split_pixels_are_weighed() -> None:
    row = np.zeros((1, 3, 4), np.uint8)
    row[0, :, 1] = [30, 60, 90]  # 3 pixels to 2: (30 + 60/2) / 1.5 and (60/2 + 90) / 1.5
    assert resize(row, 2, 1)[0, :, 1].tolist() == [40, 80]
