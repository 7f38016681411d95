"""What is fuzzed: every decoder of what comes over the bus, with valid payloads to begin from and what it promises."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel

from jouleswarm.codecs.codec import Codec
from jouleswarm.codecs.floats import FLOAT32, Float16
from jouleswarm.codecs.int8 import Int8
from jouleswarm.codecs.models import decoded, read_model
from jouleswarm.codecs.observations import decode_experience, encode_experience
from jouleswarm.codecs.png import Png
from jouleswarm.codecs.raw import Raw
from jouleswarm.codecs.resized import Resized
from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.codecs.topk import TopK
from jouleswarm.common.bus.reporter import MAX_REPORT_BYTES, MeterReport, Telemetry
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.broker_counters import BrokerLimits, BrokerSnapshot, CountersPiece, CountersRequest
from jouleswarm.common.wire.messages import (
    MAX_REWARD,
    Episode,
    ModelHeader,
    MotionHeader,
    Presence,
    RoundRequest,
    decode_json,
    encode_json,
)
from jouleswarm.common.wire.models import MAX_WEIGHT
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.saved_models import check_model
from jouleswarm.common.wire.types import Array, Payload

SHAPES = {"0.weight": (4, 4, 3, 3), "0.bias": (4,), "5.weight": (4, 16), "5.bias": (4,)}
CAMERA, NETWORK = (Observation(shape=shape, dtype="uint8") for shape in ((12, 16, 4), (6, 8, 4)))
CODECS = (FLOAT32, Float16(), Int8(), TopK(0.1))
EXPERIENCE = (Raw("uint8"), Png(), Resized(NETWORK))


@dataclass(frozen=True)
class Target:
    """A decoder. `decode` raises PayloadError, or AssertionError where what it decoded breaks a promise."""

    name: str
    seeds: tuple[bytes, ...]
    decode: Callable[[Payload], None]


def targets() -> tuple[Target, ...]:
    """All decoders; the same valid payloads each time."""
    rng = np.random.default_rng(1)
    through_codecs = (*map(_model, CODECS), *(_motion(codec, rng) for codec in EXPERIENCE))
    return (*map(_meant, through_codecs), _kept_model(), *_messages())


def _meant(target: Target) -> Target:
    """A codec may be anybody's, and what it raises is refused by name; one that ships here refuses on purpose."""

    def read(payload: Payload) -> None:
        try:
            target.decode(payload)
        except PayloadError as error:
            if " raises " in str(error):
                raise AssertionError(str(error)) from error
            raise

    return Target(target.name, target.seeds, read)


def _weights(seed: int) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    return {name: rng.normal(size=shape).astype(np.float32) for name, shape in SHAPES.items()}


def _header(round_: int) -> ModelHeader:
    return ModelHeader(task=2, agent=3, round=round_, reward=41.5, samples=20, rewards={3: (round_, 40.0), 4: (1, -3)})


def _model(codec: Codec) -> Target:
    encoder, base = WeightsEncoder(codec), _weights(0)

    def read(payload: Payload) -> None:
        tensors, header = read_model(payload, SHAPES, codec)
        _promise_weights(decoded(codec, tensors, SHAPES, base))
        assert all(
            abs(reward) <= MAX_REWARD and 1 <= round_ <= header.round for round_, reward in header.rewards.values()
        )
        assert header.reward is None or abs(header.reward) <= MAX_REWARD

    seeds = tuple(encoder.payload(_weights(round_), _header(round_), 4) for round_ in (1, 2))
    return Target(f"model {codec.name}", seeds, read)


def _promise_weights(weights: Mapping[str, Array]) -> None:
    assert {name: tensor.shape for name, tensor in weights.items()} == SHAPES
    for tensor in weights.values():
        assert tensor.dtype == np.float32
        assert np.abs(tensor).max() <= MAX_WEIGHT * (1 + 1e-6)  # false for NaN


def _kept_model() -> Target:
    def read(payload: Payload) -> None:
        assert check_model(payload).round >= 0

    return Target("model kept", (WeightsEncoder(FLOAT32).payload(_weights(1), _header(9), 4),), read)


def _motion(codec: Codec, rng: np.random.Generator) -> Target:
    def read(payload: Payload) -> None:
        frame, header = decode_experience(payload, codec, CAMERA, NETWORK)
        assert frame.shape == NETWORK.shape
        assert frame.dtype == np.uint8
        assert abs(header.reward) <= MAX_REWARD
        assert header.action >= 0

    frame = rng.integers(0, 256, CAMERA.shape, np.uint8)
    header = MotionHeader(task=2, agent=3, round=1, motion=0, action=3, reward=-1.5, first=True, terminated=False)
    return Target(f"motion {codec.name}", (encode_experience(frame, header, codec),), read)


def _messages() -> tuple[Target, ...]:
    meter = Meter("client")
    meter.count("agent-1", "jouleswarm/r/maml/sl/1/2/weights", "in", 1000, 1040)
    meter.count("agent-1", "jouleswarm/r/maml/ul/1/1/experience", "out", 500, 540)
    row = RoundRow(phase="fl", arm="maml", task=1, agent=2, round=3, reward=4.5, cluster_reward=3.0, seconds=0.25)
    traffic = {"messages": 1, "payload_bytes": 1000, "packet_bytes": 1040}
    snapshot = {
        "sequence": 4, "clients": 3, "links": {"sidelink": {"in": traffic, "out": traffic}},
        "events": {"taken_over": 1}, "refusals": ["a client"],
    }  # fmt: skip
    piece = {"asked": "ab", "run": "r", "piece": 1, "pieces": 2, "metering": True, "rows": meter.rows()}
    return (
        _message(Presence(agent=3, stage=2)),
        _message(RoundRequest(first=1, last=2)),
        _message(Episode(agent=1, round=2, reward=3.5)),
        _message(Telemetry.model_validate({"row": row, "received": {"uplink": 1, "sidelink": 2}})),
        _message(MeterReport(client="agent-1", rows=meter.rows(), rounds=[]), MAX_REPORT_BYTES),
        _message(BrokerLimits(message_bytes=1)),
        _message(CountersRequest(asked="ab", run="r")),
        _message(BrokerSnapshot.model_validate(snapshot), MAX_REPORT_BYTES),
        _message(CountersPiece.model_validate(piece), MAX_REPORT_BYTES),
    )


def _message(valid: BaseModel, limit_bytes: int | None = None) -> Target:
    kind = type(valid)

    def read(payload: Payload) -> None:
        message = decode_json(payload, kind, limit_bytes) if limit_bytes else decode_json(payload, kind)
        # What was taken can be written, and read again: no NaN, no number that JSON cannot hold.
        assert decode_json(encode_json(message), kind, MAX_REPORT_BYTES) == message

    return Target(kind.__name__, (encode_json(valid),), read)
