"""Weights in a codec's bytes that are refused, and why."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.codecs.codec import Codec, is_whole
from jouleswarm.codecs.floats import FLOAT32
from jouleswarm.codecs.models import check_tensors, decoded, read_model
from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.codecs.topk import INDICES, VALUES, TopK
from jouleswarm.common.errors import PayloadError, TrainingError
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.models import MAX_WEIGHT, encode_model, largest_weight
from jouleswarm.common.wire.types import Weights
from tests.codecs.made_up_models import CODECS, FIRST, HALF, HEADER, INT8, SHAPES, model, vector


def sent(codec: Codec, header: ModelHeader = FIRST, rounds: int = 1) -> bytes:
    encoder = WeightsEncoder(codec)
    return [encoder.payload(model([1, 2, 3, 4, 5, 6, 7, 8]), header) for _ in range(rounds)][-1]


@pytest.mark.parametrize("expected", CODECS, ids=lambda codec: codec.name)
@pytest.mark.parametrize("got", CODECS, ids=lambda codec: codec.name)
def test_a_payload_of_another_codec_is_refused(got: Codec, expected: Codec) -> None:
    if got == expected:
        assert is_whole(expected, read_model(sent(got), SHAPES, expected)[0], SHAPES)
        return
    with pytest.raises(PayloadError, match=expected.name):
        read_model(sent(got), SHAPES, expected)


def relabelled(weights: Weights, codec: str) -> bytes:
    return encode_model(weights, FIRST.model_copy(update={"codec": codec}))


def test_the_header_must_name_the_codec_even_where_the_tensors_fit() -> None:
    weights = model([1.0] * 8)
    with pytest.raises(PayloadError, match="in float32, expected topk"):
        read_model(encode_model(weights, FIRST), SHAPES, TopK())
    with pytest.raises(PayloadError, match="in topk, expected float32"):
        read_model(relabelled(weights, "topk"), SHAPES, FLOAT32)


def test_differences_in_a_first_round_are_refused() -> None:
    codec = TopK(0.25)
    with pytest.raises(PayloadError, match="expected a whole model in the first round"):
        read_model(sent(codec, FIRST, rounds=2), SHAPES, codec)


def test_another_share_is_refused() -> None:
    with pytest.raises(PayloadError, match="expected"):
        read_model(sent(TopK(0.5), HEADER, rounds=2), SHAPES, TopK(0.25))


def test_where_both_topk_layouts_are_equally_long_the_names_tell() -> None:
    codec = TopK(0.5)  # 4 x 8 bytes as well as 8 x 4
    read = [read_model(sent(codec, HEADER, rounds), SHAPES, codec)[0] for rounds in (1, 2)]
    assert [is_whole(codec, tensors, SHAPES) for tensors in read] == [True, False]


HALF_NAN = {"a": np.full((2, 3), np.nan, np.float16), "b": np.zeros(2, np.float16)}
HALF_LARGE = {"a": np.full((2, 3), -10008, np.float16), "b": np.zeros(2, np.float16)}
HALF_INF = {"a": np.full((2, 3), np.inf, np.float16), "b": np.zeros(2, np.float16)}
STEPS = {"a": np.ones((2, 3), np.int8), "b": np.ones(2, np.int8)}


def scales(a: float) -> dict[str, npt.NDArray[np.float32]]:
    return {"a.scale": np.array(a, np.float32), "b.scale": np.array(1, np.float32)}


def differences(indices: list[int], value: float = 1.0) -> dict[str, npt.NDArray[np.generic]]:
    return {VALUES: np.full(2, value, np.float32), INDICES: np.array(indices, np.int32)}


@pytest.mark.parametrize(
    ("codec", "tensors", "reason"),
    [
        (HALF, HALF_NAN, "a is not finite"),
        (HALF, HALF_INF, "a is not finite"),
        (HALF, HALF_LARGE, "a has a weight of size 10008, expected at most 10000"),
        (INT8, {**scales(np.nan), **STEPS}, "a.scale is not finite"),
        (INT8, {**scales(-1.0), **STEPS}, r"a.scale is -1.0, expected 0 or more"),
        (INT8, {**scales(78.8), **STEPS}, r"a\.scale is 78.8, expected at most 78.7402"),  # 10^4 / 127
        (INT8, {**scales(1.0), **STEPS, "b": np.array([0, -128], np.int8)}, "b has a step of -128"),
        (INT8, {**scales(1.0), **STEPS, "a": np.ones((3, 2), np.int8)}, r"a: got .*\(3, 2\)"),
        (CODECS[3], differences([0, 1], np.inf), "topk.values is not finite"),
        (CODECS[3], differences([0, 1], -2e4), "topk.values has a weight of size 20000"),
        (CODECS[3], differences([-1, 1]), "topk.indices are not ascending from 0 to 7"),
        (CODECS[3], differences([1, 8]), "topk.indices are not ascending"),
        (CODECS[3], differences([3, 3]), "topk.indices are not ascending"),
        (CODECS[3], differences([3, 2]), "topk.indices are not ascending"),
        (CODECS[3], differences([1, -(2**31)]), "topk.indices are not ascending"),
    ],
)
def test_bad_values_are_refused_and_the_reason_named(
    codec: Codec, tensors: dict[str, npt.NDArray[np.generic]], reason: str
) -> None:
    payload = encode_model(tensors, HEADER.model_copy(update={"codec": codec.name}))
    with pytest.raises(PayloadError, match=reason):
        read_model(payload, SHAPES, codec)


@given(st.sampled_from(CODECS[1:]), st.data())
def test_a_flipped_byte_is_read_as_finite_weights_or_refused(codec: Codec, data: st.DataObject) -> None:
    payload = bytearray(sent(codec, HEADER, rounds=2))
    place = data.draw(st.integers(0, len(payload) - 1))
    payload[place] ^= data.draw(st.integers(1, 255))
    try:
        tensors, _ = read_model(payload, SHAPES, codec)
    except PayloadError:
        return
    got = decoded(codec, tensors, SHAPES, model([0.0] * 8))
    assert all(np.isfinite(tensor).all() for tensor in got.values())


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_a_sender_whose_weights_would_be_refused_ends_instead_of_being_asked_for_them_for_ever(
    codec: Codec,
) -> None:
    WeightsEncoder(codec).encode(vector(MAX_WEIGHT, -MAX_WEIGHT))
    for value in (10001.0, -10001.0, np.inf, np.nan):
        with pytest.raises(TrainingError, match="w has a weight of size"):
            WeightsEncoder(codec).encode(vector(0.0, value))


@given(st.lists(st.floats(width=16, allow_nan=False), min_size=1, max_size=9))
def test_the_largest_half_is_found_from_its_bits(values: list[float]) -> None:
    assert largest_weight(np.array(values, np.float16)) == max(map(abs, values))


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_one_weight_that_is_no_number_makes_the_largest_no_finite_one(dtype: type) -> None:
    for value in (np.nan, -np.nan, np.inf, -np.inf):
        assert not math.isfinite(largest_weight(np.array([1.0, value, -2.0], dtype)))


def test_check_takes_whatever_an_encoder_sends() -> None:
    for codec in CODECS:
        check_tensors(codec, codec.encode(model([1.0] * 8), model([0.0] * 8)), SHAPES)
