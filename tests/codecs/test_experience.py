"""Codecs of one's own for observations: arrays in place of weights."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from jouleswarm.codecs.observations import (
    decode_experience,
    encode_experience,
    experience_bytes,
    experience_codec_of,
)
from jouleswarm.codecs.trial import try_experience
from jouleswarm.common.errors import ConfigurationError, PayloadError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import MotionHeader
from jouleswarm.common.wire.tensorfile import tensor_bytes
from jouleswarm.runs.sizes import scenario_sizes
from jouleswarm.simulation import run_in_memory
from tests.made_up import image

ROOT = Path(__file__).parents[2]
HEADER = MotionHeader(task=1, agent=2, round=1, motion=0, action=3, reward=-1.5, first=True, terminated=False)
# The page's own example.
(NIBBLES,) = (
    block
    for block in re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "doors.md").read_text(), re.DOTALL)
    if "class Nibbles" in block
)
ZIPPED = """
import zlib
import numpy as np

class Zipped:
    name, lossless = "zipped", True
    def layout(self, shapes, whole):
        return {"zip": ("U8", (-1,))}
    def encode(self, arrays, base):
        return {"zip": np.frombuffer(zlib.compress(arrays["frame"].tobytes(), 1), np.uint8)}
    def decode(self, tensors, shapes, base):
        return {"frame": np.frombuffer(zlib.decompress(tensors["zip"].tobytes()), np.uint8).reshape(shapes["frame"])}
"""


def scenario_with(folder: Path, name: str, codec: str, *overrides: str, of: str = "toy") -> Scenario:
    """A scenario of ours beside a file mine.py that holds `codec`."""
    (folder / "mine.py").write_text(codec)
    (folder / "own.toml").write_text((ROOT / "scenarios" / f"{of}.toml").read_text())
    return load_scenario(folder / "own.toml", [f"meta.experience_codec='{name}'", *overrides])


def refusal(folder: Path, name: str, codec: str, of: str = "toy") -> str:
    with pytest.raises(ConfigurationError) as caught:
        try_experience(scenario_with(folder, name, codec, of=of))  # once the environment has been made
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"scenario {folder / 'own.toml'}: ")


def test_four_bits_a_pixel_by_hand(tmp_path: Path) -> None:
    codec = experience_codec_of(scenario_with(tmp_path, "mine:Nibbles", NIBBLES))
    frame = np.array([[[0x12, 0x34, 0xF6]]], np.uint8)
    tensors = codec.encode({"frame": frame}, None)
    assert tensors["frame"][0] == 0x13
    assert tensors["frame"][1] >> 4 == 0xF  # and half a byte of nothing
    payload = encode_experience(frame, HEADER, codec)
    got, header = decode_experience(payload, codec, image(1, 1, 3), image(1, 1, 3))
    assert (got.tolist(), header.codec) == ([[[0x18, 0x38, 0xF8]]], "nibbles")
    # Of the toy's camera, 64 x 48 pixels of 4 bytes, half.
    assert experience_bytes(codec, image(48, 64)) == tensor_bytes(
        encode_experience(np.zeros((48, 64, 4), np.uint8), HEADER, codec)
    ) == 64 * 48 * 2  # fmt: skip


def test_a_run_learns_from_experience_through_it_and_prices_its_bytes(tmp_path: Path) -> None:
    small = ("federation.max_rounds=2", "meta.t0=2", "methods=['maml','centralized']", "learning.motions_per_round=6")
    raw, half, zipped = (
        scenario_with(tmp_path, name, NIBBLES + ZIPPED, *small) for name in ("raw", "mine:Nibbles", "mine:Zipped")
    )
    assert scenario_sizes(half).experience_bytes * 2 == scenario_sizes(raw).experience_bytes == 6 * 48 * 64 * 4
    assert scenario_sizes(zipped).experience_bytes == scenario_sizes(raw).experience_bytes
    plain, packed = run_in_memory(raw), run_in_memory(zipped)
    assert packed.learned == plain.learned
    assert {row.refused for row in packed.rows} == {0}
    sent = [
        sum(row.payload_bytes for row in each.hub.meter.rows() if row.link == "uplink" and row.direction == "out")
        for each in (plain, packed)
    ]
    assert sent[1] < sent[0]


def test_a_codec_of_weights_takes_vectors_of_float32(tmp_path: Path) -> None:
    codec = experience_codec_of(scenario_with(tmp_path, "float16", "", of="cartpole"))
    shown = load_scenario("cartpole").spaces.observation
    payload = encode_experience(np.array([0.5, -1.25, 0.1, 3.0], np.float32), HEADER, codec)
    got, _ = decode_experience(payload, codec, shown, shown)
    assert tensor_bytes(payload) == experience_bytes(codec, shown) == 8
    assert got.tolist() == [0.5, -1.25, float(np.float16(0.1)), 3.0]


WRONG = {
    "images alone": ("png", "", "cartpole", "for images of 1, 3, 4 channels, the environment shows float32 [4]"),
    "images alone, resized": ("resized", "", "cartpole", "for images, the environment shows float32 [4]; expected raw"),
    "another dtype": ("float16", "", "toy", "an observation of float32, expected uint8 [48, 64, 4]"),
    "no such word": ("jpg", "", "toy", "expected float16, float32, int8, png, raw, resized, topk or module:name"),
    "another shape": (
        "mine:Zipped", ZIPPED.replace("reshape(shapes", "ravel() if shapes else (shapes"), "toy",
        "an observation of shape [12288], expected uint8 [48, 64, 4]",
    ),
    "another name": ("mine:Zipped", ZIPPED.replace('{"frame": np', '{"image": np'), "toy", "an observation of object"),
    "not lossless": (
        "mine:Nibbles", NIBBLES.replace("False", "True"), "toy",
        "it is lossless, and an observation came back with other bits",
    ),
    "two sizes that vary": ("mine:Zipped", ZIPPED.replace("(-1,)", "(-1, -1)"), "toy", "layout gives {'zip': ('U8', ("),
    "decode raises": (
        "mine:Zipped", ZIPPED.replace("zlib.decompress(", "zlib.decompress(b'0' + "), "toy",
        "decode raises error: Error -3 while decompressing data: incorrect header check (mine.py, line 12)",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_with_it_is_one_line(tmp_path: Path, case: str) -> None:
    name, codec, of, reason = WRONG[case]
    assert refusal(tmp_path, name, codec, of).startswith(f"codec {name!r}: {reason}")


def test_what_cannot_be_decoded_is_refused_with_the_robots_number(tmp_path: Path) -> None:
    codec = experience_codec_of(scenario_with(tmp_path, "mine:Zipped", ZIPPED))
    payload = bytearray(encode_experience(np.zeros((48, 64, 4), np.uint8), HEADER, codec))
    payload[-1] ^= 1
    with pytest.raises(PayloadError, match=r"motion of robot 2: codec zipped: decode raises error: Error -3 .*mine.py"):
        decode_experience(payload, codec, image(48, 64), image(12, 16))
