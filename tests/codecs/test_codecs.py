"""Weights in fewer bits: what comes back, and how far it is from what was sent."""

import math

import numpy as np
import numpy.typing as npt
import pytest
import safetensors.numpy
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.codecs.codec import Codec
from jouleswarm.codecs.floats import FLOAT32
from jouleswarm.codecs.models import read_model
from jouleswarm.codecs.observations import experience_bytes
from jouleswarm.codecs.png import Png
from jouleswarm.codecs.raw import Raw
from jouleswarm.codecs.resized import Resized
from jouleswarm.codecs.streams import WeightsDecoder, WeightsEncoder
from jouleswarm.codecs.topk import INDICES, VALUES, TopK, topk_entries
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire.models import MAX_WEIGHT, encode_model
from jouleswarm.common.wire.tensorfile import tensor_bytes
from jouleswarm.common.wire.types import Weights
from jouleswarm.runs.sizes import weights_bytes
from tests.codecs.made_up_models import CODECS, FIRST, HALF, HEADER, INT8, SHAPES, model, vector
from tests.made_up import image

LARGEST = float(np.finfo(np.float32).max)
LEAST = float(np.finfo(np.float32).smallest_subnormal)

finite32 = st.floats(width=32, allow_nan=False, allow_infinity=False)
eight = st.lists(st.floats(-MAX_WEIGHT, MAX_WEIGHT, width=32), min_size=8, max_size=8)


def flat(weights: Weights) -> npt.NDArray[np.float64]:
    return np.concatenate([tensor.reshape(-1) for tensor in weights.values()]).astype(np.float64)


def through(codec: Codec, weights: Weights) -> Weights:
    return codec.decode(codec.encode(weights, None), {name: tensor.shape for name, tensor in weights.items()}, None)


@given(eight)
def test_float32_is_lossless_to_the_bit(values: list[float]) -> None:
    weights = model(values)
    assert all(through(FLOAT32, weights)[name].tobytes() == tensor.tobytes() for name, tensor in weights.items())


@given(st.lists(st.floats(-65504, 65504, width=32), min_size=1, max_size=20))
def test_float16_is_right_to_half_a_unit_in_the_last_place(values: list[float]) -> None:
    weights = vector(*values)
    exact = flat(weights)
    error = np.abs(flat(through(HALF, weights)) - exact)
    # 11 significant bits; below the least normal half, 2^-14, steps of 2^-24
    assert (error <= np.maximum(np.abs(exact) * 2.0**-11, 2.0**-25)).all()


def test_float16_clips_to_the_largest_half_instead_of_sending_infinity() -> None:
    assert through(HALF, vector(65519.0, 1e30, -LARGEST, 1.0))["w"].tolist() == [65504.0, 65504.0, -65504.0, 1.0]


@given(st.lists(finite32, min_size=1, max_size=20))
def test_int8_is_right_to_half_a_step_of_the_tensors_scale(values: list[float]) -> None:
    weights = vector(*values)
    scale = float(INT8.encode(weights, None)["w.scale"])
    back, exact = flat(through(INT8, weights)), flat(weights)
    # half a step, and the rounding of the product to float32: up to 127 steps x 2^-24
    assert (np.abs(back - exact) <= scale * (0.5 + 127 * 2.0**-24)).all()
    assert np.isfinite(back).all()
    assert scale <= max(np.abs(exact)) / 127 * (1 + 2.0**-22) + LEAST


def test_int8_has_a_scale_for_each_tensor() -> None:
    # steps of 1 and of 2: 3.4 is 3 of the first, 5.0 is 2.5 of the second, half way, to the even 2
    tensors = INT8.encode({"a": np.array([127, 3.4, -127], np.float32), "b": np.array([-254, 5], np.float32)}, None)
    assert {name: tensor.tolist() for name, tensor in tensors.items()} == {
        "a.scale": 1.0, "b.scale": 2.0, "a": [127, 3, -127], "b": [-127, 2],
    }  # fmt: skip
    assert list(tensors) == ["a.scale", "b.scale", "a", "b"]  # float32 first, where they are aligned


@pytest.mark.parametrize("values", [[0.0, -0.0], [LARGEST, -LARGEST], [LEAST, 0.0], [190 * LEAST, -3 * LEAST]])
def test_int8_takes_zero_the_largest_and_the_least_numbers(values: list[float]) -> None:
    weights = vector(*values)
    back = flat(through(INT8, weights))
    scale = float(INT8.encode(weights, None)["w.scale"])
    assert np.isfinite(back).all()
    assert (np.abs(back - flat(weights)) <= scale * (0.5 + 127 * 2.0**-24)).all()


def test_a_topk_message_has_the_entries_that_moved_most_as_their_new_values() -> None:
    codec, base = TopK(0.4), vector(1.0, 1.0, 1.0, 1.0, 1.0)
    weights = vector(1.5, -2.0, 1.0, 4.5, 1.25)  # differences 0.5, 3, 0, 3.5, 0.25; 0.4 of 5 entries are 2
    tensors = codec.encode(weights, base)
    assert (tensors[INDICES].tolist(), tensors[VALUES].tolist()) == ([1, 3], [-2.0, 4.5])
    assert (tensors[INDICES].dtype, tensors[VALUES].dtype) == (np.int32, np.float32)
    assert codec.decode(tensors, {"w": (5,)}, base)["w"].tolist() == [1.0, -2.0, 1.0, 4.5, 1.0]


def test_equal_differences_are_taken_in_the_order_of_their_indices() -> None:
    tensors = TopK(0.5).encode(vector(1, -1, 2, 1, -1, 1), vector(0, 0, 0, 0, 0, 0))
    assert tensors[INDICES].tolist() == [0, 1, 2]


def test_topk_is_over_all_tensors_together() -> None:
    codec, base = TopK(0.25), model([0.0] * 8)
    tensors = codec.encode(model([0, 0, 0, 0, 0, 7, 9, 1]), base)  # entry 5 is a's last, entry 6 b's first
    assert (tensors[INDICES].tolist(), tensors[VALUES].tolist()) == ([5, 6], [7.0, 9.0])
    got = codec.decode(tensors, SHAPES, base)
    assert (got["a"].tolist(), got["b"].tolist()) == ([[0, 0, 0], [0, 0, 7]], [9, 0])
    assert flat(base).tolist() == [0.0] * 8  # what was handed out before stays as it is


@pytest.mark.parametrize(
    ("entries", "share", "sent"),
    [(100, 0.07, 7), (100, 0.071, 8), (8, 0.05, 1), (1_391_268, 0.05, 69_564), (10, 1.0, 10), (3, 0.34, 2)],
)
def test_topk_sends_its_share_rounded_up(entries: int, share: float, sent: int) -> None:
    assert topk_entries(entries, share) == sent


@given(eight, eight, st.sampled_from([0.05, 0.1, 0.125, 0.3, 0.5, 1.0]))
def test_a_model_that_stands_still_is_reached_to_the_bit_after_1_over_share_messages(
    before: list[float], values: list[float], share: float
) -> None:
    encoder, decoder = WeightsEncoder(TopK(share)), WeightsDecoder(TopK(share), SHAPES)
    decoder.decode(encoder.encode(model(before)))
    distances = []
    for _ in range(math.ceil(1 / share)):
        got = decoder.decode(encoder.encode(model(values)))
        distances.append(np.abs(flat(got) - flat(model(values))).max())
    assert distances == sorted(distances, reverse=True)
    assert np.array_equal(flat(got), flat(model(values)))


@given(st.lists(eight, min_size=1, max_size=6), st.sampled_from(CODECS))
def test_the_sender_knows_what_receivers_hold_to_the_bit(models: list[list[float]], codec: Codec) -> None:
    encoder, decoder = WeightsEncoder(codec), WeightsDecoder(codec, SHAPES)
    for round_, values in enumerate(models, 1):
        header = FIRST.model_copy(update={"round": round_})
        tensors, _ = read_model(encoder.payload(model(values), header), SHAPES, codec)
        got = decoder.decode(tensors)
        assert list(got) == list(SHAPES)
        for name, shape in SHAPES.items():
            assert got[name].shape == shape
            assert got[name].dtype == np.float32
            assert got[name].tobytes() == encoder.public[name].tobytes()


@given(st.lists(eight, min_size=2, max_size=4), st.sampled_from(CODECS))
def test_the_same_models_give_the_same_bytes(models: list[list[float]], codec: Codec) -> None:
    one, other = WeightsEncoder(codec), WeightsEncoder(codec)
    for values in models:
        assert one.payload(model(values), HEADER) == other.payload(model(values), HEADER)


def test_after_a_rebase_differences_are_to_the_new_base_on_both_sides() -> None:
    codec = TopK(0.5)
    encoder, decoder = WeightsEncoder(codec), WeightsDecoder(codec, {"w": (2,)})
    decoder.decode(encoder.encode(vector(1.0, 2.0)))
    encoder.rebase(vector(10.0, 20.0))
    decoder.rebase(vector(10.0, 20.0))
    assert decoder.decode(encoder.encode(vector(11.0, 20.5)))["w"].tolist() == [11.0, 20.0]


def test_differences_without_a_base_are_refused() -> None:
    codec = TopK(0.5)
    with pytest.raises(PayloadError, match="expected a whole model first"):
        WeightsDecoder(codec, {"w": (2,)}).decode(codec.encode(vector(1, 2), vector(0, 0)))


def test_a_float32_payload_is_what_it_was_before_there_were_codecs() -> None:
    weights = model([1, 2, 3, 4, 5, 6, 7, 8])
    payload = WeightsEncoder(FLOAT32).payload(weights, HEADER, 2)
    assert payload == encode_model(weights, HEADER, 2)
    assert b"codec" not in payload


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_a_saved_payload_opens_in_the_safetensors_library(codec: Codec) -> None:
    encoder = WeightsEncoder(codec)
    weights = model([1, 2, 3, 4, 5, 6, 7, 8])
    for _ in range(2):
        opened = safetensors.numpy.load(encoder.payload(weights, HEADER))
    expected = {
        "float32": {"a": "float32", "b": "float32"},
        "float16": {"a": "float16", "b": "float16"},
        "int8": {"a.scale": "float32", "b.scale": "float32", "a": "int8", "b": "int8"},
        "topk": {"topk.values": "float32", "topk.indices": "int32"},
    }
    assert {name: str(tensor.dtype) for name, tensor in opened.items()} == expected[codec.name]


@given(
    st.sampled_from(CODECS),
    st.integers(2, 10**6),
    st.none() | st.floats(-1e9, 1e9),
    st.integers(0, 10**5),
    eight,
)
def test_payloads_of_a_codec_have_one_size_after_the_first(
    codec: Codec, round_: int, reward: float | None, samples: int, values: list[float]
) -> None:
    encoder = WeightsEncoder(codec)
    encoder.encode(model([0.0] * 8))
    header = HEADER.model_copy(update={"round": round_, "reward": reward, "samples": samples})
    size = len(encoder.payload(model([1.0] * 8), HEADER))
    assert len(encoder.payload(model(values), header)) == size


@pytest.mark.parametrize(
    ("codec", "first", "later"),
    [  # 8 entries in 2 tensors
        (FLOAT32, 32, 32),
        (HALF, 16, 16),
        (INT8, 16, 16),  # 8 + 2 x 4
        (TopK(0.25), 32, 16),  # 2 entries of 8 bytes
    ],
)
def test_a_messages_tensors_take_the_expected_bytes(codec: Codec, first: int, later: int) -> None:
    assert (weights_bytes(codec, SHAPES, whole=True), weights_bytes(codec, SHAPES, whole=False)) == (first, later)
    encoder = WeightsEncoder(codec)
    sizes = [tensor_bytes(encoder.payload(model([1.0] * 8), HEADER)) for _ in range(3)]
    assert sizes == [first, later, later]


def test_a_frame_takes_the_expected_bytes() -> None:
    codecs = (Raw("uint8"), Resized(image(72, 96)), Png())
    assert [experience_bytes(codec, image(480, 640)) for codec in codecs] == [1_228_800, 27_648, None]
