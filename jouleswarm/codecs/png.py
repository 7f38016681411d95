"""png: images losslessly compressed; how far depends on the image."""

from __future__ import annotations

import math
import struct
from typing import Self

import cv2
import numpy as np

from jouleswarm.common.errors import ConfigurationError, PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import PNG_CHANNELS
from jouleswarm.common.wire.types import Layout, Shapes, Tensors

PICTURE = "png"
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# The smallest on the landmarks' frames of what OpenCV offers, and not slow: sensor noise leaves nothing to be matched.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY)


class Png:
    """See `codecs.codec.Codec`; of one image, uint8 [height, width, channels]."""

    name, lossless = "png", True

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        shown = scenario.spaces.observation
        if not shown.is_image or shown.shape[2] not in PNG_CHANNELS:
            channels = ", ".join(map(str, PNG_CHANNELS))
            raise ConfigurationError(f"for images of {channels} channels, the environment shows {shown}; expected raw")
        return cls()

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        return {PICTURE: ("U8", (-1,))}

    def encode(self, weights: Tensors, base: Tensors | None) -> Tensors:
        (image,) = weights.values()
        # Channels stand for blue, green, red and alpha here, whatever they are: none is changed.
        return {PICTURE: np.asarray(cv2.imencode(".png", image, _PNG)[1], np.uint8).reshape(-1)}

    def decode(self, tensors: Tensors, shapes: Shapes, base: Tensors | None) -> Tensors:
        ((name, shape),) = shapes.items()
        try:
            image = cv2.imdecode(tensors[PICTURE], cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            raise PayloadError(f"not a PNG: {error}") from error
        if image is None or math.prod(image.shape) != math.prod(shape):
            raise PayloadError(f"PNG of shape {None if image is None else image.shape}, expected {shape}")
        return {name: np.asarray(image).reshape(shape)}

    def check(self, tensors: Tensors, shapes: Shapes) -> None:
        (shape,) = shapes.values()
        size, limit = tensors[PICTURE].size, largest_png(shape)
        if not 0 < size <= limit:
            raise PayloadError(f"{size} bytes of PNG, expected 1 to {limit}")
        _check_structure(tensors[PICTURE].tobytes(), shape)


def largest_png(shape: tuple[int, ...]) -> int:
    """No image of this shape takes more bytes as PNG: raw pixels, a byte a row, and a chunk header every 8 KiB."""
    size = math.prod(shape)
    return size + size // 64 + shape[0] + 1024


def _check_structure(picture: bytes, shape: tuple[int, ...]) -> None:
    """Look at a PNG's structure before anything is allocated or inflated for it.

    Raises:
        PayloadError: not one of 8 bits a channel at this size, or one with more in it than pixels.
    """
    height, width, channels = shape
    kind, colour_type = PNG_CHANNELS[channels]
    # bit depth, colour type, compression, filter, no interlace
    format_ = bytes([8, colour_type, 0, 0, 0])
    beginning = _SIGNATURE + struct.pack(">I4sII", 13, b"IHDR", width, height) + format_
    if not picture.startswith(beginning):
        raise PayloadError(f"PNG begins {picture[:29]!r}, expected {kind}, 8 bits, {width} x {height}")
    place, chunk = len(beginning) + 4, b"IHDR"
    while place + 12 <= len(picture) and chunk != b"IEND":
        length, chunk = struct.unpack_from(">I4s", picture, place)
        if chunk not in (b"IDAT", b"IEND"):
            raise PayloadError(f"PNG with a chunk {chunk!r}, expected pixels alone")
        place += 12 + length
    if chunk != b"IEND" or place != len(picture):
        raise PayloadError(f"PNG of {len(picture)} bytes ends in {chunk!r} at {place}, expected IEND")
