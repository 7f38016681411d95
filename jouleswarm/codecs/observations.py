"""One motion's observation on the uplink: as it was seen, or an image losslessly compressed or shrunk to the network's
input.

The data center learns from images at the network's size, so that all three give it the same pixels.
"""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from jouleswarm.codecs.frames import shrink
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.sections import ExperienceCodec
from jouleswarm.common.scenario.spaces import PNG_CHANNELS, Observation
from jouleswarm.common.wire.messages import (
    MOTION_METADATA_BYTES,
    MotionHeader,
    check_codec,
    decode_motion,
    encode_motion,
)
from jouleswarm.common.wire.tensorfile import decode_tensors, encode_tensors, tensor_bytes
from jouleswarm.common.wire.types import Payload

Array = npt.NDArray[Any]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# The smallest on this camera's frames of what OpenCV offers, and not slow: sensor noise leaves nothing to be matched.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY)


def encode_experience(observation: Array, header: MotionHeader, codec: ExperienceCodec, kept: Observation) -> bytes:
    """A motion as its payload.

    Args:
        observation: as the environment shows it.
        kept: what a replay memory keeps of it.
    """
    if codec == "raw":
        return encode_motion(observation, header)
    header = header.model_copy(update={"codec": codec})
    if codec == "resized":
        return encode_motion(shrink(observation, kept), header)
    # Channels stand for blue, green, red and alpha here, whatever they are: none is changed.
    picture = np.asarray(cv2.imencode(".png", observation, _PNG)[1], np.uint8).reshape(-1)
    return encode_tensors({"png": picture}, header, MOTION_METADATA_BYTES)


def decode_experience(
    payload: Payload, codec: ExperienceCodec, shown: Observation, kept: Observation
) -> tuple[Array, MotionHeader]:
    """A motion and its observation as a replay memory keeps it.

    Args:
        shown, kept: what the environment shows, and what is kept of it.

    Raises:
        PayloadError: not a motion of this codec and such an observation.
    """
    if codec == "resized":
        return decode_motion(payload, kept, "resized")
    observation, header = decode_motion(payload, shown) if codec == "raw" else _decode_png(payload, shown)
    return shrink(observation, kept), header


def _decode_png(payload: Payload, shown: Observation) -> tuple[Array, MotionHeader]:
    size, limit = tensor_bytes(payload), largest_png(shown)
    if not 0 < size <= limit:
        raise PayloadError(f"motion: {size} bytes of PNG, expected 1 to {limit}")
    tensors, header = decode_tensors(payload, [{"png": ("U8", (size,))}], MotionHeader, "motion")
    check_codec(header, "png")
    picture = tensors["png"]
    _check_png(picture.tobytes(), shown)
    try:
        frame = cv2.imdecode(picture, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise PayloadError(f"motion of robot {header.agent}: not a PNG: {error}") from error
    if frame is not None and frame.ndim == 2:
        frame = frame[..., np.newaxis]
    shape = None if frame is None else frame.shape
    if frame is None or shape != shown.shape or frame.dtype != np.uint8:
        raise PayloadError(f"motion of robot {header.agent}: PNG of shape {shape}, expected {shown.shape}")
    return np.asarray(frame, np.uint8), header


def largest_png(image: Observation) -> int:
    """No image of this shape takes more bytes as PNG: raw pixels, a byte a row, and a chunk header every 8 KiB."""
    return image.nbytes + image.nbytes // 64 + image.shape[0] + 1024


def _check_png(picture: bytes, image: Observation) -> None:
    """Look at a PNG's structure before anything is allocated or inflated for it.

    Raises:
        PayloadError: not one of 8 bits a channel at this size, or one with more in it than pixels.
    """
    height, width, channels = image.shape
    kind, colour_type = PNG_CHANNELS[channels]
    # bit depth, colour type, compression, filter, no interlace
    format_ = bytes([8, colour_type, 0, 0, 0])
    beginning = _SIGNATURE + struct.pack(">I4sII", 13, b"IHDR", width, height) + format_
    if not picture.startswith(beginning):
        raise PayloadError(f"motion: PNG begins {picture[:29]!r}, expected {kind}, 8 bits, {width} x {height}")
    place, chunk = len(beginning) + 4, b"IHDR"
    while place + 12 <= len(picture) and chunk != b"IEND":
        length, chunk = struct.unpack_from(">I4s", picture, place)
        if chunk not in (b"IDAT", b"IEND"):
            raise PayloadError(f"motion: PNG with a chunk {chunk!r}, expected pixels alone")
        place += 12 + length
    if chunk != b"IEND" or place != len(picture):
        raise PayloadError(f"motion: PNG of {len(picture)} bytes ends in {chunk!r} at {place}, expected IEND")
