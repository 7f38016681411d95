"""Between the core and a codec that may be anybody's: what it does wrong in a run, and what is kept for it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.codecs.floats import FLOAT32, Float16, Float32
from jouleswarm.codecs.models import decoded, encoded, read_model
from jouleswarm.codecs.streams import WeightsDecoder, WeightsEncoder
from jouleswarm.common.errors import PayloadError, TrainingError
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.models import encode_model
from jouleswarm.common.wire.types import Layout, Shapes, Tensors, Weights

SHAPES = {"w": (2,)}
HEADER = ModelHeader(task=1, agent=2, round=3, reward=1.0, samples=20, rewards={2: (3, 1.0)}, codec="mine")


def vector(*values: float) -> Weights:
    return {"w": np.array(values, np.float32)}


class Xor:
    """Lossless, and told as what has changed: bits of the weights, exclusive or with the base's."""

    name, lossless = "mine", True

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        return {name: ("U32", shape) for name, shape in shapes.items()}

    def encode(self, weights: Weights, base: Weights | None) -> Tensors:
        return {name: w.view(np.uint32) ^ (base[name].view(np.uint32) if base else 0) for name, w in weights.items()}

    def decode(self, tensors: Tensors, shapes: Shapes, base: Weights | None) -> Weights:
        bits = {name: tensors[name] ^ (base[name].view(np.uint32) if base else 0) for name in shapes}
        return {name: each.astype(np.uint32).view(np.float32) for name, each in bits.items()}


class Positive(Xor):
    """One that cannot write everything, and knows what it can have written."""

    def encode(self, weights: Weights, base: Weights | None) -> Tensors:
        if min(weights["w"]) < 0:
            raise ValueError("less than nothing")
        return super().encode(weights, base)

    def check(self, tensors: Tensors, shapes: Shapes) -> None:
        if tensors["w"][0] == 7:
            raise ValueError("seven")


def test_an_encoder_that_fails_ends_the_sender_with_the_codecs_name_and_line() -> None:
    with pytest.raises(
        TrainingError, match=r"codec mine: encode raises ValueError: less than nothing \(test_models.py, "
    ):
        WeightsEncoder(Positive()).encode(vector(1, -1))


def test_a_check_of_its_own_refuses_a_message_of_a_named_robot() -> None:
    payload = encode_model({"w": np.array([7, 8], np.uint32)}, HEADER)
    with pytest.raises(PayloadError, match="model of robot 2, round 3: codec mine: check raises ValueError: seven"):
        read_model(payload, SHAPES, Positive())


@pytest.mark.parametrize(("bits", "reason"), [(0x7FC00000, "nan"), (0x461C4400, None), (0x47000000, "32768")])
def test_what_is_decoded_without_a_check_is_finite_weights_or_refused(bits: int, reason: str | None) -> None:
    payload = encode_model({"w": np.array([0, bits], np.uint32)}, HEADER)
    tensors, _ = read_model(payload, SHAPES, Xor())
    if reason is None:
        assert decoded(Xor(), tensors, SHAPES, vector(0, 0))["w"].tolist() == [0, 10001]  # lossy ones may carry past
    else:
        with pytest.raises(
            PayloadError, match=f"codec mine: decode gives w a weight of size {reason}, expected at most 20000"
        ):
            decoded(Xor(), tensors, SHAPES, vector(0, 0))


def test_a_lossless_codec_that_tells_differences_keeps_its_base_and_others_nothing() -> None:
    xor, plain = WeightsEncoder(Xor()), WeightsEncoder(FLOAT32)
    decoder, again = WeightsDecoder(Xor(), SHAPES), WeightsDecoder(Xor(), SHAPES)
    for encoder in (xor, plain):
        encoder.encode(vector(1, 2))
    decoder.decode(Xor().encode(vector(1, 2), None))
    assert plain.state().arrays == {}
    assert xor.state().arrays["w"].tolist() == [1, 2]
    again.load_state(decoder.state())
    assert again.decode(xor.encode(vector(1, 3)))["w"].tolist() == [1, 3]


def test_tensors_go_in_the_order_of_the_layout_whatever_the_order_of_the_encoder() -> None:
    class Backwards(Float32):
        def encode(self, weights: Weights, base: Weights | None) -> Tensors:
            return dict(reversed(weights.items()))

    weights = {"b": np.ones(1, np.float32), "a": np.ones(2, np.float32)}
    assert list(encoded(Backwards(), weights, None)) == ["b", "a"]


@given(st.integers(1, 10**6), st.none() | st.floats(-1e9, 1e9), st.integers(0, 10**5))
def test_a_message_has_one_size_with_the_longest_name_of_a_codec(
    round_: int, reward: float | None, samples: int
) -> None:
    class Named(Float16):
        name = "x" * 32

    encoder = WeightsEncoder(Named())
    header = HEADER.model_copy(update={"round": round_, "reward": reward, "samples": samples})
    assert len(encoder.payload(vector(1, 2), header, 2)) == len(encoder.payload(vector(1, 2), HEADER, 2))
