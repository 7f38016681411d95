"""One motion's frame on the uplink: as the camera took it, losslessly compressed, or as small as the network's input.

The data center learns from frames at the network's size, so that all three give it the same pixels.
"""

from __future__ import annotations

import struct

import cv2
import numpy as np
import numpy.typing as npt

from jouleswarm.codecs.frames import resize
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.sections import ExperienceCodec
from jouleswarm.common.wire.messages import (
    MOTION_METADATA_BYTES,
    MotionHeader,
    check_codec,
    decode_motion,
    encode_motion,
)
from jouleswarm.common.wire.tensorfile import decode_tensors, encode_tensors, tensor_bytes
from jouleswarm.common.wire.types import Payload

Frame = npt.NDArray[np.uint8]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_RGBA_8_BIT = bytes([8, 6, 0, 0, 0])  # bit depth, colour type, compression, filter, no interlace
# The smallest on this camera's frames of what OpenCV offers, and not slow: sensor noise leaves nothing to be matched.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY)


def encode_experience(frame: Frame, header: MotionHeader, codec: ExperienceCodec, width: int, height: int) -> bytes:
    """A motion as its payload.

    Args:
        frame: the camera's, uint8 [camera height, camera width, 4].
        width, height: of the network's input, pixels.
    """
    if codec == "raw":
        return encode_motion(frame, header)
    header = header.model_copy(update={"codec": codec})
    if codec == "resized":
        return encode_motion(resize(frame, width, height), header)
    # The four channels stand for blue, green, red and alpha here, whatever they are: none is changed.
    picture = np.asarray(cv2.imencode(".png", frame, _PNG)[1], np.uint8).reshape(-1)
    return encode_tensors({"png": picture}, header, MOTION_METADATA_BYTES)


def decode_experience(
    payload: Payload, codec: ExperienceCodec, camera: tuple[int, int], network: tuple[int, int]
) -> tuple[Frame, MotionHeader]:
    """A motion and its frame at the network's size, uint8 [height, width, 4].

    Args:
        camera, network: (width, height) of the camera's frame and of the network's input, pixels.

    Raises:
        PayloadError: not a motion of this codec and these sizes.
    """
    width, height = network
    if codec == "resized":
        return decode_motion(payload, height, width, "resized")
    if codec == "raw":
        frame, header = decode_motion(payload, camera[1], camera[0])
    else:
        frame, header = _decode_png(payload, *camera)
    return resize(frame, width, height), header


def _decode_png(payload: Payload, width: int, height: int) -> tuple[Frame, MotionHeader]:
    size, limit = tensor_bytes(payload), largest_png(width, height)
    if not 0 < size <= limit:
        raise PayloadError(f"motion: {size} bytes of PNG, expected 1 to {limit}")
    tensors, header = decode_tensors(payload, [{"png": ("U8", (size,))}], MotionHeader, "motion")
    check_codec(header, "png")
    picture = tensors["png"]
    _check_png(picture.tobytes(), width, height)
    try:
        frame = cv2.imdecode(picture, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise PayloadError(f"motion of robot {header.agent}: not a PNG: {error}") from error
    shape = None if frame is None else frame.shape
    if frame is None or shape != (height, width, 4) or frame.dtype != np.uint8:
        raise PayloadError(f"motion of robot {header.agent}: PNG of shape {shape}, expected {(height, width, 4)}")
    return np.asarray(frame, np.uint8), header


def largest_png(width: int, height: int) -> int:
    """No frame of this size takes more bytes as PNG: raw pixels, a byte a row, and a chunk header every 8 KiB."""
    raw = 4 * width * height
    return raw + raw // 64 + height + 1024


def _check_png(picture: bytes, width: int, height: int) -> None:
    """Look at a PNG's structure before anything is allocated or inflated for it.

    Raises:
        PayloadError: not one of 8-bit RGBA at this size, or one with more in it than pixels.
    """
    beginning = _SIGNATURE + struct.pack(">I4sII", 13, b"IHDR", width, height) + _RGBA_8_BIT
    if not picture.startswith(beginning):
        raise PayloadError(f"motion: PNG begins {picture[:29]!r}, expected RGBA, 8 bits, {width} x {height}")
    place, kind = len(beginning) + 4, b"IHDR"
    while place + 12 <= len(picture) and kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", picture, place)
        if kind not in (b"IDAT", b"IEND"):
            raise PayloadError(f"motion: PNG with a chunk {kind!r}, expected pixels alone")
        place += 12 + length
    if kind != b"IEND" or place != len(picture):
        raise PayloadError(f"motion: PNG of {len(picture)} bytes ends in {kind!r} at {place}, expected IEND")
