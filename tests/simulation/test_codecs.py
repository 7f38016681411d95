"""Whole runs over the in-memory bus with each codec: they complete, and move the bytes that are expected of them."""

import functools
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from jouleswarm.codecs.codec import Codec, codec_of
from jouleswarm.codecs.observations import experience_bytes, experience_codec_of
from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import ModelHeader, MotionHeader
from jouleswarm.common.wire.saved_models import check_model
from jouleswarm.common.wire.tensorfile import tensor_bytes
from jouleswarm.common.wire.types import Weights
from jouleswarm.learning.heads import head_of, meta_shapes
from jouleswarm.learning.networks import build_qnetwork, shapes_of, to_weights
from jouleswarm.runs.sizes import weights_bytes
from jouleswarm.simulation import Outcome, run_in_memory
from tests.made_up import encode_motion, image

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"
ROUNDS, T0, MOTIONS = 3, 2, 6
METHODS = "methods=['maml','fl','fedavg','centralized']"
CODECS = ("float32", "float16", "int8", "topk")
# No robot can reach a target of 1000: every arm lasts ROUNDS rounds.
SMALL = [
    f"federation.max_rounds={ROUNDS}", "federation.target_reward=1000", f"meta.t0={T0}",
    f"learning.motions_per_round={MOTIONS}", "learning.batches_per_round=4",
]  # fmt: skip


def small(*overrides: str) -> Scenario:
    return load_scenario(TOY, [*SMALL, *overrides])


def network(scenario: Scenario) -> Weights:
    return to_weights(build_qnetwork(scenario))


def meta_model(scenario: Scenario) -> Weights:
    """The network and a last layer for the training task."""
    head = head_of(build_qnetwork(scenario))
    shapes = meta_shapes(shapes_of(build_qnetwork(scenario)), head, scenario.meta.training_tasks)
    return {name: np.ones(shape, np.float32) for name, shape in shapes.items()}


def header_bytes(codec: Codec, model: Weights, robots: int) -> tuple[int, int]:
    """What a message has besides its tensors, the first one and a later one."""
    encoder = WeightsEncoder(codec)
    header = ModelHeader(task=1, agent=1, round=1, reward=1.0, samples=1)
    first, later = (encoder.payload(model, header, robots) for _ in range(2))
    return len(first) - tensor_bytes(first), len(later) - tensor_bytes(later)


def expected(codec: Codec, model: Weights, robots: int, first: int, later: int) -> tuple[int, int]:
    """(messages, payload bytes) of so many first and later weights messages."""
    shapes = {name: tensor.shape for name, tensor in model.items()}
    headers = header_bytes(codec, model, robots)
    first_bytes = weights_bytes(codec, shapes, whole=True) + headers[0]
    later_bytes = weights_bytes(codec, shapes, whole=False) + headers[1]
    return first + later, first * first_bytes + later * later_bytes


def delivered(outcome: Outcome, arm: str, link: str, word: str) -> tuple[int, int]:
    """(messages, payload bytes) delivered on topics .../arm/link/.../word, the recorder's copies left out."""
    rows = [row for row in outcome.hub.meter.rows() if _is(row, arm, link, word)]
    return sum(row.messages for row in rows), sum(row.payload_bytes for row in rows)


def _is(row: MeterRow, arm: str, link: str, word: str) -> bool:
    level = row.topic.split("/")
    wanted = (row.direction, level[2], level[3], level[-1]) == ("out", arm, link, word)
    return wanted and row.client != "recorder"


@functools.cache
def outcome_of(codec: str) -> Outcome:
    return run_in_memory(small(f"federation.codec='{codec}'", METHODS))


@pytest.mark.parametrize("codec", CODECS)
def test_every_method_completes_and_moves_the_expected_bytes(codec: str) -> None:
    scenario, outcome = small(f"federation.codec='{codec}'", METHODS), outcome_of(codec)
    lossy = codec_of(scenario)
    model, meta = (lossy, network(scenario)), (lossy, meta_model(scenario))
    # 2 clusters of 2 robots: 4 directed sidelinks, 4 robots that send up and receive
    for arm in ("maml", "fl"):
        assert delivered(outcome, arm, "sl", "weights") == expected(*model, 2, 4, 4 * (ROUNDS - 1))
    assert delivered(outcome, "maml", "dl", "meta") == expected(*meta, 0, 4, 0)
    assert delivered(outcome, "fedavg", "ul", "weights") == expected(*model, 2, 4, 4 * (ROUNDS - 1))
    assert delivered(outcome, "fedavg", "dl", "model") == expected(*model, 2, 4, 4 * (ROUNDS - 1))
    assert delivered(outcome, "centralized", "dl", "model") == expected(*model, 0, 4, 4 * (ROUNDS - 1))
    assert {row.refused for row in outcome.rows} == {0}


@pytest.mark.parametrize("codec", CODECS)
def test_learned_models_and_snapshots_are_whole_float32_files_whatever_the_codec(codec: str) -> None:
    scenario, outcome = small(f"federation.codec='{codec}'", METHODS), outcome_of(codec)
    assert (len(outcome.learned), len(outcome.snapshots)) == (8, 1)
    for payloads, model in ((outcome.learned, network(scenario)), (outcome.snapshots, meta_model(scenario))):
        for payload in payloads.values():
            assert check_model(payload).codec is None
            kept = safetensors.numpy.load(payload)
            assert {name: (tensor.shape, tensor.dtype) for name, tensor in kept.items()} == {
                name: (tensor.shape, np.float32) for name, tensor in model.items()
            }


@pytest.mark.parametrize("codec", CODECS[1:])
def test_the_same_scenario_twice_gives_the_same_bits(codec: str) -> None:
    once, again = outcome_of(codec), outcome_of.__wrapped__(codec)
    assert once.learned == again.learned
    assert once.snapshots == again.snapshots


def test_a_lossy_codec_gives_other_weights() -> None:
    assert len({outcome_of(codec).learned["fl", 1] for codec in CODECS}) == len(CODECS)


@functools.cache
def outcome_with(experience: str) -> Outcome:
    return run_in_memory(small("methods=['maml','centralized']", f"meta.experience_codec='{experience}'"))


@pytest.mark.parametrize("codec", ["png", "resized"])
def test_what_is_learned_from_experience_is_the_same_to_the_bit(codec: str) -> None:
    outcome, raw = outcome_with(codec), outcome_of("float32")
    assert outcome.learned == {key: raw.learned[key] for key in outcome.learned}
    assert outcome.snapshots == raw.snapshots
    assert {row.refused for row in outcome.rows} == {0}
    for arm, word in (("maml", "experience"), ("centralized", "transition")):
        moved, raw_moved = (delivered(each, arm, "ul", word) for each in (outcome, raw))
        assert moved[0] == raw_moved[0]
        assert moved[1] < raw_moved[1]


@pytest.mark.parametrize("codec", ["raw", "resized"])
def test_experience_moves_the_expected_bytes(codec: str) -> None:
    scenario = small(f"meta.experience_codec='{codec}'")
    frame = experience_bytes(experience_codec_of(scenario), image(48, 64))
    outcome = outcome_of("float32") if codec == "raw" else outcome_with(codec)
    assert frame is not None
    shape = {"raw": (48, 64, 4), "resized": (12, 16, 4)}[codec]
    header = MotionHeader(
        task=1, agent=1, round=1, motion=0, action=0, reward=0, first=True, terminated=False,
        codec=None if codec == "raw" else "resized",
    )  # fmt: skip
    motion = encode_motion(np.zeros(shape, np.uint8), header)
    size = frame + len(motion) - tensor_bytes(motion)
    assert delivered(outcome, "maml", "ul", "experience") == (T0 * MOTIONS, T0 * MOTIONS * size)
