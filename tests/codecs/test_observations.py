"""Frames on the uplink: the same pixels for the learner whatever the codec, and what is refused before it is opened."""

import struct
import zlib

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.codecs.codec import Codec
from jouleswarm.codecs.frames import resize
from jouleswarm.codecs.observations import decode_experience, encode_experience, experience_bytes
from jouleswarm.codecs.png import Png, largest_png
from jouleswarm.codecs.raw import Raw
from jouleswarm.codecs.resized import Resized
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire.messages import MotionHeader
from jouleswarm.common.wire.tensorfile import encode_tensors, tensor_bytes
from tests.made_up import encode_motion, image

CAMERA, NETWORK = image(12, 16), image(6, 8)
HEADER = MotionHeader(task=2, agent=3, round=1, motion=0, action=3, reward=-1.5, first=True, terminated=False)
RAW, PNG, RESIZED = Raw("uint8"), Png(), Resized(NETWORK)
CODECS = (RAW, PNG, RESIZED)
Frame = npt.NDArray[np.uint8]


def frame_of(seed: int) -> Frame:
    return np.random.default_rng(seed).integers(0, 256, (12, 16, 4), dtype=np.uint8)


def encoded(frame: Frame, codec: Codec) -> bytes:
    return encode_experience(frame, HEADER, codec)


def decoded(payload: bytes, codec: Codec) -> Frame:
    return decode_experience(payload, codec, CAMERA, NETWORK)[0]


@given(st.integers(0, 2**32))
def test_the_learner_gets_the_same_pixels_whatever_the_codec(seed: int) -> None:
    frame = frame_of(seed)
    for codec in CODECS:
        got, header = decode_experience(encoded(frame, codec), codec, CAMERA, NETWORK)
        assert np.array_equal(got, resize(frame, 8, 6))
        assert header.model_copy(update={"padding": "", "codec": None}) == HEADER


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_png_holds_pictures_of_one_three_and_four_channels(channels: int) -> None:
    shown, kept = image(12, 16, channels), image(6, 8, channels)
    frame = np.random.default_rng(1).integers(0, 256, shown.shape, dtype=np.uint8)
    got, _ = decode_experience(encoded(frame, PNG), PNG, shown, kept)
    assert np.array_equal(got, resize(frame, 8, 6))
    assert got.shape == kept.shape
    with pytest.raises(PayloadError, match="PNG begins"):
        decode_experience(encoded(frame, PNG), PNG, image(12, 16, {1: 3, 3: 4, 4: 1}[channels]), kept)


@pytest.mark.parametrize("depth", [0, 128, 255])  # as transparency it would hide the colours
def test_png_changes_no_channel(depth: int) -> None:
    frame = frame_of(1)
    frame[..., 3] = depth
    same_size = decode_experience(encoded(frame, PNG), PNG, CAMERA, CAMERA)[0]
    assert np.array_equal(same_size, frame)


def test_a_raw_motion_is_what_it_was_before_there_were_codecs() -> None:
    payload = encoded(frame_of(1), RAW)
    assert payload == encode_motion(frame_of(1), HEADER)
    assert b"codec" not in payload


def test_the_frame_takes_the_expected_bytes() -> None:
    sizes = {codec: tensor_bytes(encoded(frame_of(1), codec)) for codec in CODECS}
    assert (sizes[RAW], sizes[RESIZED]) == (4 * 16 * 12, 4 * 8 * 6)
    assert all(experience_bytes(codec, CAMERA) in (sizes[codec], None) for codec in CODECS)


def test_a_smooth_frame_is_smaller_as_png_and_noise_stays_within_the_limit() -> None:
    smooth = np.full((480, 640, 4), 100, np.uint8)
    noise = np.random.default_rng(1).integers(0, 256, (480, 640, 4), dtype=np.uint8)
    sizes = [tensor_bytes(encode_experience(frame, HEADER, PNG)) for frame in (smooth, noise)]
    assert sizes[0] < 0.2 * smooth.nbytes
    assert noise.nbytes < sizes[1] <= largest_png((480, 640, 4))


@pytest.mark.parametrize("expected", CODECS)
@pytest.mark.parametrize("got", CODECS)
def test_a_motion_of_another_codec_is_refused(got: Codec, expected: Codec) -> None:
    payload = encoded(frame_of(1), got)
    if got == expected:
        assert decoded(payload, expected).shape == (6, 8, 4)
        return
    with pytest.raises(PayloadError, match="motion"):
        decoded(payload, expected)


def test_where_camera_and_network_have_one_size_the_header_tells_raw_from_resized() -> None:
    payload = encode_experience(frame_of(1), HEADER, Resized(CAMERA))
    with pytest.raises(PayloadError, match="resized, expected raw"):
        decode_experience(payload, RAW, CAMERA, CAMERA)


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def with_ihdr(width: int, height: int, depth: int = 8, colour: int = 6) -> bytes:
    return GOOD[:8] + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)) + GOOD[33:]


def carried(picture: bytes, codec: str | None = "png") -> bytes:
    header = HEADER.model_copy(update={"codec": codec})
    return encode_tensors({"png": np.frombuffer(picture, np.uint8)}, header, 320)


GOOD = cv2.imencode(".png", frame_of(1))[1].tobytes()
THREE = cv2.imencode(".png", np.ascontiguousarray(frame_of(1)[..., :3]))[1].tobytes()
LARGEST = largest_png(CAMERA.shape)
DEEP = cv2.imencode(".png", frame_of(1).astype(np.uint16))[1].tobytes()

REFUSED: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "-1 bytes of png"),
    "short": (b"1234567", "-1 bytes of png"),
    "garbage": (b"garbage of more than eight bytes", "bytes of png"),
    "no picture": (carried(b""), "0 bytes of PNG, expected 1 to"),
    "no PNG": (carried(b"GIF89a" + bytes(60)), "PNG begins"),
    "signature alone": (carried(GOOD[:8]), "PNG begins"),
    "a bomb": (carried(with_ihdr(60000, 60000)), "expected RGBA, 8 bits, 16 x 12"),
    "sides swapped": (carried(with_ihdr(12, 16)), "PNG begins"),
    "three channels": (carried(THREE), "PNG begins"),
    "16 bits": (carried(DEEP), "PNG begins"),
    "beyond the limit": (carried(GOOD + bytes(LARGEST)), f"bytes of PNG, expected 1 to {LARGEST}"),
    "far beyond it": (carried(bytes(2 * CAMERA.nbytes + 4097)), "5633 bytes of png, expected up to 5632"),
    "a text in it": (carried(GOOD[:33] + chunk(b"zTXt", b"x") + GOOD[33:]), "chunk b'zTXt'"),
    "cut off": (carried(GOOD[:-20]), "ends in"),
    "without an end": (carried(GOOD[:-12]), "ends in"),
    "something after its end": (carried(GOOD + b"more"), "ends in"),
    "a chunk longer than the file": (carried(GOOD[:33] + struct.pack(">I", 2**31) + GOOD[37:]), "ends in"),
    "no pixels": (carried(GOOD[:33] + chunk(b"IEND", b"")), "PNG"),
    "pixels that do not inflate": (carried(GOOD[:33] + chunk(b"IDAT", b"no zlib") + chunk(b"IEND", b"")), "PNG"),
    "not called png": (carried(GOOD, None), "raw, expected png"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_picture_is_refused_and_the_reason_named(case: str) -> None:
    payload, reason = REFUSED[case]
    with pytest.raises(PayloadError, match=reason):
        decoded(payload, PNG)


@given(st.data())
def test_a_flipped_byte_is_read_or_refused(data: st.DataObject) -> None:
    payload = bytearray(carried(GOOD))
    place = data.draw(st.integers(0, len(payload) - 1))
    payload[place] ^= data.draw(st.integers(1, 255))
    try:
        assert decoded(bytes(payload), PNG).shape == (6, 8, 4)
    except PayloadError:
        return
