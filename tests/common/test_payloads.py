"""What goes over the bus, and what is refused."""

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors
import safetensors.numpy
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.codecs.floats import FLOAT32
from jouleswarm.codecs.models import read_model
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.messages import (
    MAX_HEADER_BYTES,
    MAX_REWARD,
    ModelHeader,
    MotionHeader,
    Presence,
    RoundRequest,
    decode_json,
    encode_json,
)
from jouleswarm.common.wire.models import MAX_WEIGHT, encode_model
from jouleswarm.common.wire.saved_models import check_model
from tests.made_up import decode_motion, encode_motion, image

WEIGHTS = {
    "0.weight": np.arange(6, dtype=np.float32).reshape(2, 3) / 7,
    "0.bias": np.array([-1.5, 2.5], np.float32),
}
SHAPES = {name: tensor.shape for name, tensor in WEIGHTS.items()}
HEADER = ModelHeader(task=2, agent=3, round=9, reward=41.5, samples=20, rewards={3: (9, 40.0), 4: (8, 43.0)})
MOTION = MotionHeader(task=2, agent=3, round=1, motion=0, action=3, reward=-1.5, first=True, terminated=False)
FRAME = np.arange(2 * 3 * 4, dtype=np.uint8).reshape(2, 3, 4)

finite = st.floats(-MAX_REWARD, MAX_REWARD)
finite32 = st.floats(-MAX_WEIGHT, MAX_WEIGHT, width=32)


def taken_apart(payload: bytes) -> tuple[dict[str, Any], bytes]:
    (length,) = struct.unpack_from("<Q", payload)
    return json.loads(payload[8 : 8 + length]), payload[8 + length :]


def put_together(entries: Any, data: bytes) -> bytes:
    text = json.dumps(entries).encode()
    return struct.pack("<Q", len(text)) + text + data


def altered(change: Callable[[dict[str, Any]], None], payload: bytes | None = None) -> bytes:
    entries, data = taken_apart(encode_model(WEIGHTS, HEADER) if payload is None else payload)
    change(entries)
    return put_together(entries, data)


@given(
    values=st.lists(finite32, min_size=8, max_size=8),
    round_=st.integers(0, 10**6),
    reward=st.none() | finite,
    samples=st.integers(0, 10**6),
    rewards=st.dictionaries(st.integers(1, 999), st.tuples(st.integers(1, 10**6), finite), max_size=12),
)
def test_a_model_comes_back_bit_by_bit(
    values: list[float], round_: int, reward: float | None, samples: int, rewards: dict[int, tuple[int, float]]
) -> None:
    flat = np.array(values, np.float32)
    weights = {"0.weight": flat[:6].reshape(2, 3), "0.bias": flat[6:]}
    rewards = {agent: known for agent, known in rewards.items() if known[0] <= round_}
    header = ModelHeader(task=2, agent=3, round=round_, reward=reward, samples=samples, rewards=rewards)
    decoded, got = read_model(encode_model(weights, header), SHAPES, FLOAT32)
    assert list(decoded) == list(weights)
    assert all(decoded[name].tobytes() == tensor.tobytes() for name, tensor in weights.items())
    assert got.model_copy(update={"padding": ""}) == header


@given(st.binary(min_size=24, max_size=24), st.integers(0, 3), finite, st.booleans(), st.booleans())
def test_a_motion_comes_back_bit_by_bit(
    pixels: bytes, action: int, reward: float, first: bool, terminated: bool
) -> None:
    frame = np.frombuffer(pixels, np.uint8).reshape(2, 3, 4)
    header = MotionHeader(
        task=1, agent=2, round=3, motion=4, action=action, reward=reward, first=first, terminated=terminated
    )
    decoded, got = decode_motion(encode_motion(frame, header), image(2, 3))
    assert np.array_equal(decoded, frame)
    assert got.model_copy(update={"padding": ""}) == header


DTYPES = (
    "bool",
    "uint8",
    "int8",
    "uint16",
    "int16",
    "uint32",
    "int32",
    "uint64",
    "int64",
    "float16",
    "float32",
    "float64",
)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [(), (4,), (2, 3, 4)])
def test_an_observation_of_any_dtype_and_shape_comes_back_and_takes_its_own_bytes(
    dtype: str, shape: tuple[int, ...]
) -> None:
    seen = np.random.default_rng(1).integers(0, 2, shape).astype(dtype)
    payload = encode_motion(seen, MOTION)
    expected = Observation(shape=shape, dtype=dtype)
    decoded, _ = decode_motion(payload, expected)
    assert (decoded.dtype, decoded.shape, decoded.tobytes()) == (seen.dtype, shape, seen.tobytes())
    assert len(payload) - 8 - struct.unpack_from("<Q", payload)[0] == seen.nbytes == expected.nbytes
    assert np.array_equal(safetensors.numpy.load(payload)["frame"], seen)


@pytest.mark.parametrize(
    ("seen", "expected", "reason"),
    [
        (np.zeros(4, np.float32), Observation(shape=(4,), dtype="int32"), "frame: got"),
        (np.zeros(4, np.float32), Observation(shape=(5,), dtype="float32"), "bytes"),
        (np.full(4, np.inf, np.float32), Observation(shape=(4,), dtype="float32"), "not finite, expected float32 [4]"),
        (np.array(7), Observation(shape=(), dtype="int64", values=7), "an observation of 7, expected Discrete(7)"),
        (np.array(-1), Observation(shape=(), dtype="int64", values=7), "an observation of -1"),
    ],
)
def test_an_observation_that_cannot_have_been_seen_is_refused(seen: Any, expected: Observation, reason: str) -> None:
    with pytest.raises(PayloadError) as caught:
        decode_motion(encode_motion(seen, MOTION), expected)
    assert reason in str(caught.value)


def test_any_bytes_like_payload_is_read() -> None:
    payload = encode_model(WEIGHTS, HEADER)
    for kind in (bytes, bytearray, memoryview):
        assert read_model(kind(payload), SHAPES, FLOAT32)[1].round == 9


def test_a_saved_model_opens_in_the_safetensors_library_with_the_papers_fields(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    path.write_bytes(encode_model(WEIGHTS, HEADER))
    with safetensors.safe_open(path, framework="np") as file:
        metadata = file.metadata()
        opened = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    assert all(np.array_equal(opened[name], tensor) for name, tensor in WEIGHTS.items())
    wanted = {"schema": "jouleswarm.model/1", "task": "2", "agent": "3", "round": "9", "reward": "41.5"}
    assert wanted.items() <= metadata.items()
    assert json.loads(metadata["rewards"]) == {"3": [9, 40.0], "4": [8, 43.0]}


def test_a_motion_opens_in_the_safetensors_library() -> None:
    assert np.array_equal(safetensors.numpy.load(encode_motion(FRAME, MOTION))["frame"], FRAME)


def test_a_tensor_of_another_memory_order_is_written_row_by_row() -> None:
    weights = {"0.weight": np.asfortranarray(WEIGHTS["0.weight"]), "0.bias": WEIGHTS["0.bias"]}
    assert encode_model(weights, HEADER) == encode_model(WEIGHTS, HEADER)


@given(
    st.integers(1, 10**6),
    st.none() | finite,
    st.integers(0, 10**5),
    st.lists(finite, min_size=2, max_size=2),
)
def test_a_robots_payload_has_one_size_whatever_round_and_rewards(
    round_: int, reward: float | None, samples: int, known: list[float]
) -> None:
    header = ModelHeader(
        task=2, agent=3, round=round_, reward=reward, samples=samples, rewards={3: (round_, known[0]), 4: (1, known[1])}
    )
    assert len(encode_model(WEIGHTS, header)) == len(encode_model(WEIGHTS, HEADER))


def test_a_payload_of_the_first_round_is_as_long_as_one_that_knows_the_whole_cluster() -> None:
    alone = HEADER.model_copy(update={"rewards": {3: (1, 40.0)}})
    assert len(encode_model(WEIGHTS, alone, robots=2)) == len(encode_model(WEIGHTS, HEADER))
    assert len(encode_model(WEIGHTS, alone)) < len(encode_model(WEIGHTS, HEADER))


@given(st.integers(1, 10**6), st.integers(0, 10**6), finite, st.booleans())
def test_every_motion_has_one_size(round_: int, motion: int, reward: float, terminated: bool) -> None:
    header = MOTION.model_copy(
        update={"round": round_, "motion": motion, "reward": reward, "terminated": terminated, "first": False}
    )
    assert len(encode_motion(FRAME, header)) == len(encode_motion(FRAME, MOTION))


def test_tensors_begin_at_a_multiple_of_8_bytes() -> None:
    payload = encode_model(WEIGHTS, HEADER)
    assert (len(payload) - 8 * 4) % 8 == 0  # 8 floats follow the header


def test_equal_models_are_equal_files() -> None:
    assert encode_model(WEIGHTS, HEADER) == encode_model(dict(WEIGHTS), HEADER.model_copy())


REFUSED: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "0 bytes"),
    "truncated": (encode_model(WEIGHTS, HEADER)[:-1], "header of"),
    "cut off in the header": (encode_model(WEIGHTS, HEADER)[:100], "header of"),
    "longer": (encode_model(WEIGHTS, HEADER) + b"\0", "header of"),
    "huge header length": (
        struct.pack("<Q", 2**63) + encode_model(WEIGHTS, HEADER)[8:],
        "header of 9223372036854775808",
    ),
    "header beyond the limit": (
        put_together({"__metadata__": {"padding": " " * MAX_HEADER_BYTES}}, bytes(32)),
        "expected 32 and a header",
    ),
    "not JSON": (struct.pack("<Q", 16) + b"{" * 16 + bytes(32), "not a safetensors file"),
    "JSON but no object": (put_together([1, 2, 3], bytes(32)), "not a safetensors file"),
    "JSON nested deeply": (struct.pack("<Q", 60000) + b"[" * 60000 + bytes(32), "not a safetensors file"),
    "no metadata": (altered(lambda entries: entries.pop("__metadata__")), "not a safetensors file"),
    "other schema": (
        altered(lambda entries: entries["__metadata__"].update(schema="jouleswarm.model/2")),
        "schema.*jouleswarm.model/1",
    ),
    "an experience": (encode_motion(np.zeros((2, 4, 4), np.uint8), MOTION), "schema"),
    "negative round": (altered(lambda entries: entries["__metadata__"].update(round="-1")), "round"),
    "round no number": (altered(lambda entries: entries["__metadata__"].update(round="soon")), "round"),
    "unknown field": (altered(lambda entries: entries["__metadata__"].update(mood="good")), "mood"),
    "rewards no JSON": (altered(lambda entries: entries["__metadata__"].update(rewards="{")), "rewards"),
    "rewards no pairs": (altered(lambda entries: entries["__metadata__"].update(rewards='{"1": 3}')), "rewards"),
    "reward NaN": (altered(lambda entries: entries["__metadata__"].update(reward="NaN")), "reward"),
    "reward infinite": (altered(lambda entries: entries["__metadata__"].update(reward="inf")), "reward"),
    "a neighbour's reward NaN": (
        altered(lambda entries: entries["__metadata__"].update(rewards='{"3": [9, NaN]}')),
        "rewards",
    ),
    "other dtype": (
        altered(lambda entries: entries["0.weight"].update(dtype="I32")),
        "0.weight: got .*I32.*expected.*F32",
    ),
    "other shape": (altered(lambda entries: entries["0.weight"].update(shape=[3, 2])), r"0.weight: got .*\(3, 2\)"),
    "other name": (
        altered(lambda entries: entries.update({"1.weight": entries.pop("0.weight")})),
        "0.weight: got None",
    ),
    "one tensor more": (
        altered(lambda entries: entries.update(x={"dtype": "F32", "shape": [0], "data_offsets": [32, 32]})),
        "x: got .*expected None",
    ),
    "offsets overlap": (
        altered(lambda entries: entries["0.bias"].update(data_offsets=[0, 8])),
        "not a safetensors file",
    ),
    "offsets outside": (
        altered(lambda entries: entries["0.bias"].update(data_offsets=[32, 40])),
        "not a safetensors file",
    ),
    "NaN": (encode_model({**WEIGHTS, "0.bias": np.array([0, math.nan], np.float32)}, HEADER), "0.bias is not finite"),
    "infinite": (encode_model({**WEIGHTS, "0.bias": np.array([math.inf, 0], np.float32)}, HEADER), "not finite"),
    "reward wildly large": (altered(lambda entries: entries["__metadata__"].update(reward="1e300")), "reward"),
    "samples beyond 64 bits": (altered(lambda entries: entries["__metadata__"].update(samples="9" * 30)), "samples"),
    "infinities that cancel": (
        encode_model({**WEIGHTS, "0.bias": np.array([math.inf, -math.inf], np.float32)}, HEADER),
        "not finite",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_model_is_refused_and_the_reason_named(case: str) -> None:
    payload, reason = REFUSED[case]
    with pytest.raises(PayloadError, match=reason):
        read_model(payload, SHAPES, FLOAT32)


def test_weights_up_to_the_limit_are_taken_and_larger_ones_refused() -> None:
    for bias in ([1e4, -1e4], [0.0, 0.0]):
        weights = {**WEIGHTS, "0.bias": np.array(bias, np.float32)}
        assert read_model(encode_model(weights, HEADER), SHAPES, FLOAT32)[0]["0.bias"].tolist() == bias
    for bias in ([10001.0, 0.0], [0.0, -10001.0], [3e38, -3e38]):
        weights = {**WEIGHTS, "0.bias": np.array(bias, np.float32)}
        with pytest.raises(PayloadError, match=r"0\.bias has a weight of size .*, expected at most 10000"):
            read_model(encode_model(weights, HEADER), SHAPES, FLOAT32)


def test_a_model_for_the_run_directory_is_refused_for_the_same_values() -> None:
    assert check_model(encode_model(WEIGHTS, HEADER)).round == 9
    for value, reason in ((math.nan, "not finite"), (-2e4, "expected at most")):
        with pytest.raises(PayloadError, match=reason):
            check_model(encode_model({**WEIGHTS, "0.bias": np.array([value, 0], np.float32)}, HEADER))
    with pytest.raises(PayloadError, match=r"0\.bias in I8, expected F32"):
        check_model(encode_model({**WEIGHTS, "0.bias": np.zeros(2, np.int8)}, HEADER))


def test_a_reward_from_the_future_is_refused_as_it_would_stay_the_newest_for_ever() -> None:
    payload = altered(lambda entries: entries["__metadata__"].update(rewards='{"3": [10, 1.0]}'))
    with pytest.raises(PayloadError, match="rewards of robot 3 are of round 10, expected 1 to 9"):
        read_model(payload, SHAPES, FLOAT32)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"action": "-1"}, "action"),
        ({"reward": "nan"}, "reward"),
        ({"first": "maybe"}, "first"),
        ({"agent": "0"}, "agent"),
        ({"schema": "jouleswarm.model/1"}, "schema"),
    ],
)
def test_a_bad_motion_is_refused_and_the_reason_named(change: dict[str, str], reason: str) -> None:
    payload = altered(lambda entries: entries["__metadata__"].update(change), encode_motion(FRAME, MOTION))
    with pytest.raises(PayloadError, match=reason):
        decode_motion(payload, image(2, 3))


def test_a_motion_of_another_frame_size_is_refused() -> None:
    with pytest.raises(PayloadError, match=r"\(2, 3, 4\).*expected.*\(3, 2, 4\)"):
        decode_motion(encode_motion(FRAME, MOTION), image(3, 2))


@given(st.binary(max_size=400))
def test_random_bytes_never_raise_anything_but_a_refusal(payload: bytes) -> None:
    for read in (
        lambda: read_model(payload, SHAPES, FLOAT32),
        lambda: decode_motion(payload, image(2, 3)),
        lambda: decode_json(payload, Presence),
    ):
        with pytest.raises(PayloadError):
            read()


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@given(st.sampled_from(["__metadata__", "0.weight", "0.bias", "extra"]), json_values)
def test_random_json_in_the_header_never_raises_anything_but_a_refusal(key: str, value: object) -> None:
    with pytest.raises(PayloadError):
        read_model(altered(lambda entries: entries.update({key: value})), SHAPES, FLOAT32)


@given(st.sampled_from(sorted(ModelHeader.model_json_schema(by_alias=True)["properties"])), json_values)
def test_a_random_field_is_read_or_refused(field: str, value: object) -> None:
    text = value if isinstance(value, str) else json.dumps(value)
    payload = altered(lambda entries: entries["__metadata__"].update({field: text}))
    try:
        read_model(payload, SHAPES, FLOAT32)
    except PayloadError:
        return


@given(st.data())
def test_a_flipped_byte_is_read_or_refused(data: st.DataObject) -> None:
    payload = bytearray(encode_model(WEIGHTS, HEADER))
    place = data.draw(st.integers(0, len(payload) - 1))
    payload[place] ^= data.draw(st.integers(1, 255))
    try:
        weights, _ = read_model(payload, SHAPES, FLOAT32)
    except PayloadError:
        return
    assert all(np.isfinite(tensor).all() for tensor in weights.values())


@given(st.integers(0, 2**31), st.integers(0, 2**31))
def test_control_messages_come_back(first: int, last: int) -> None:
    request = RoundRequest(first=first, last=last)
    assert decode_json(encode_json(request), RoundRequest) == request


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "Presence"),
        (b"{", "Presence"),
        (b"\xff\xfe", "Presence"),
        (b"[]", "Presence"),
        (b'{"agent": 1, "state": "asleep"}', "state"),
        (b'{"agent": 1, "mood": "good"}', "mood"),
        (b'{"agent": 1}' + b" " * MAX_HEADER_BYTES, "65548 bytes, expected at most 65536"),
    ],
)
def test_a_bad_control_message_is_refused(payload: bytes, reason: str) -> None:
    with pytest.raises(PayloadError, match=reason):
        decode_json(payload, Presence)
