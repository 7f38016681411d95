"""The example of a codec of one's own, examples/sign_codec.py: its bytes and values, worked out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jouleswarm.codecs.codec import Codec, codec_of
from jouleswarm.codecs.models import decoded, read_model
from jouleswarm.codecs.streams import WeightsDecoder, WeightsEncoder
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.models import encode_model
from jouleswarm.common.wire.tensorfile import tensor_bytes
from jouleswarm.common.wire.types import Weights
from jouleswarm.methods.mixing import default_step, mix
from jouleswarm.runs.sizes import weights_bytes

ROOT = Path(__file__).parents[2]
SHAPES = {"a": (2, 2), "b": (1,)}


@pytest.fixture(scope="module")
def sign() -> Codec:
    return codec_of(load_scenario(ROOT / "examples" / "sign.toml"))


def model(a: list[list[float]], b: float) -> Weights:
    return {"a": np.array(a, np.float32), "b": np.array([b], np.float32)}


def header(round_: int) -> ModelHeader:
    return ModelHeader(task=1, agent=2, round=round_, reward=1.0, samples=20, codec="sign")


def test_a_message_has_a_bit_an_entry_and_a_scale_a_tensor(sign: Codec) -> None:
    # a has moved by 1, -3, 0 and 4, on average 2, up but for the second; b by -0.5
    tensors = sign.encode(model([[1, -3], [0, 4]], 0.5), model([[0, 0], [0, 0]], 1.0))
    assert {name: tensor.tolist() for name, tensor in tensors.items()} == {
        "a.scale": 2.0, "b.scale": 0.5, "a": [0b10110000], "b": [0b00000000],
    }  # fmt: skip


def test_receivers_come_nearer_by_the_average_in_each_message(sign: Codec) -> None:
    encoder, decoder = WeightsEncoder(sign), WeightsDecoder(sign, SHAPES)
    first, aim = model([[0, 0], [0, 0]], 1.0), model([[1, -3], [0, 4]], 0.5)
    held = []
    for round_, weights in enumerate([first, aim, aim], 1):
        payload = encoder.payload(weights, header(round_))
        got = decoder.decode(read_model(payload, SHAPES, sign)[0])
        held.append((tensor_bytes(payload), got["a"].tolist(), got["b"].tolist()))
    assert held == [
        (20, [[0, 0], [0, 0]], [1]),  # 5 float32
        (10, [[2, -2], [2, 2]], [0.5]),  # 2 scales of 4 bytes, and 4 + 1 bits in a byte each
        (10, [[0.5, -3.5], [0.5, 3.5]], [0.5]),  # what is left, -1, -1, -2 and 2, by 1.5
    ]
    assert [weights_bytes(sign, SHAPES, whole=whole) for whole in (True, False)] == [20, 10]


def test_two_robots_that_mix_by_signs_come_together_at_their_mean(sign: Codec) -> None:
    rng = np.random.default_rng(1)
    models = [{"w": rng.normal(size=200).astype(np.float32)} for _ in range(2)]
    mean = (models[0]["w"] + models[1]["w"]) / 2
    encoders = [WeightsEncoder(sign), WeightsEncoder(sign)]
    for _ in range(400):
        for encoder, own in zip(encoders, models, strict=True):
            encoder.encode(own)
        public = [encoder.public for encoder in encoders]
        models = [mix(models[k], {1 - k: public[1 - k]}, {1 - k: 1.0}, default_step(1), public[k]) for k in (0, 1)]
    for each in models:
        np.testing.assert_allclose(each["w"], mean, rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    ("scale", "reason"), [(np.nan, "a.scale is not finite"), (2e4, "a.scale has a weight of size 20000")]
)
def test_a_scale_that_no_robot_sends_is_refused(sign: Codec, scale: float, reason: str) -> None:
    tensors = sign.encode(model([[1, -3], [0, 4]], 0.5), model([[0, 0], [0, 0]], 1.0))
    payload = encode_model({**tensors, "a.scale": np.array(scale, np.float32)}, header(2))
    with pytest.raises(PayloadError, match=f"model of robot 2, round 2: {reason}"):
        read_model(payload, SHAPES, sign)


def test_a_model_that_grows_beyond_all_weights_is_refused(sign: Codec) -> None:
    base = model([[0, 0], [0, 0]], 1.0)
    tensors = {**sign.encode(base, base), "a.scale": np.array(9e3, np.float32)}
    for _ in range(2):
        base = decoded(sign, tensors, SHAPES, base)
    with pytest.raises(PayloadError, match="codec sign: decode gives a a weight of size 27000, expected at most 20000"):
        decoded(sign, tensors, SHAPES, base)


def test_signs_without_a_model_to_apply_them_to_are_refused(sign: Codec) -> None:
    tensors = sign.encode(model([[1, -3], [0, 4]], 0.5), model([[0, 0], [0, 0]], 1.0))
    with pytest.raises(PayloadError, match="expected a whole model first"):
        WeightsDecoder(sign, SHAPES).decode(tensors)
    with pytest.raises(PayloadError, match="expected a whole model in the first round"):
        read_model(encode_model(tensors, header(1)), SHAPES, sign)


def test_the_page_prints_the_example_as_it_is() -> None:
    _, _, code = (ROOT / "examples" / "sign_codec.py").read_text().split('"""', 2)
    assert f"```python{code}```" in (ROOT / "docs" / "doors.md").read_text().replace("```python\n", "```python\n\n")
