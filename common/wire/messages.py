"""Messages as bytes. Models and experience are safetensors files; control is JSON. Nothing is unpickled.

The paper's payload (section IV-A) is binary weights, task, round and average running reward: here tensors,
with the other fields in the safetensors metadata, so that a payload saved from the bus opens in any ML tool.
Headers are padded to a fixed size: a robot's payload is as long in round 9 as in round 10.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Annotated, Literal, Self, TypeVar

from pydantic import BaseModel, BeforeValidator, Field, ValidationError, model_validator

from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire.tensorfile import (
    MAX_HEADER_BYTES,
    Header,
    first_reason,
)
from jouleswarm.common.wire.types import Payload

MOTION_METADATA_BYTES = 320
MAX_REWARD = 1e9
"""The largest |reward| that is taken: scenarios stay far below, and in float32 its square is finite, so no message can
make a learner's loss infinite."""
MAX_PROCESSOR = 400
MAX_COUNT = 2**53
"""Whole numbers up to here are exact in every reader of JSON, and far from what numpy's 64 bits hold."""
MAX_TOLD = 300
"""Characters that a process may use to say what it waits for."""
RAW = "raw"
"""The codec of a motion whose header names none."""
CODEC_NAME = r"^[A-Za-z0-9_.-]{1,32}$"
"""What a codec may call itself: it stands in every header, whose size is fixed."""

Count = Annotated[int, Field(ge=0, le=MAX_COUNT)]
Reward = Annotated[float, Field(ge=-MAX_REWARD, le=MAX_REWARD, allow_inf_nan=False)]


def from_json(value: object) -> object:
    """A metadata value that is no text stands there as JSON."""
    return json.loads(value) if isinstance(value, str) else value


class ModelHeader(Header):
    """Metadata of a model on the wire: the paper's fields, and what the neighbours decide with."""

    schema_: Literal["jouleswarm.model/1"] = Field("jouleswarm.model/1", alias="schema")
    task: Count = Field(description="0: the meta-model")
    agent: Count = Field(description="0: the data center")
    round: Count
    reward: Reward | None = Field(None, description="average running reward R of the sender")
    samples: Count = Field(0, description="|E_k|: new transitions of the round")
    rewards: Annotated[dict[int, tuple[int, Reward]], BeforeValidator(from_json)] = Field(
        default_factory=dict, description="newest known (round, episode reward) of each robot of the cluster"
    )
    codec: str | None = Field(None, pattern=CODEC_NAME, description="of the tensors; none: float32")
    padding: str = ""

    @model_validator(mode="after")
    def _rewards_are_past(self) -> Self:
        # One from the future would stay the newest for ever, and be passed on.
        for agent, (round_, _) in self.rewards.items():
            first = min(1, self.round)
            if not first <= round_ <= self.round:
                raise ValueError(f"rewards of robot {agent} are of round {round_}, expected {first} to {self.round}")
        return self


class MotionHeader(Header):
    """Metadata of one motion's experience (x_h, y_h, r_h)."""

    schema_: Literal["jouleswarm.experience/1"] = Field("jouleswarm.experience/1", alias="schema")
    task: int = Field(ge=1, le=MAX_COUNT)
    agent: int = Field(ge=1, le=MAX_COUNT)
    round: int = Field(ge=1, le=MAX_COUNT)
    motion: Count
    action: Count
    reward: Reward
    first: Annotated[bool, BeforeValidator(from_json)] = Field(description="the frame opens an episode")
    terminated: Annotated[bool, BeforeValidator(from_json)]
    codec: str | None = Field(None, pattern=CODEC_NAME, description="of the observation; none: raw")
    padding: str = ""


class Presence(Header):
    """Where a process stands: its `stage` only grows (see agents/robot.py).

    done: it has ended, and nobody needs it any more; the recorder removes this when the run is over. Of the recorder
    itself, that the whole run is recorded.
    """

    agent: Count
    stage: Count = 0
    state: Literal["here", "gone", "done"] = Field("here", description="gone: the last will of a process that died")
    processor: str | None = Field(None, max_length=MAX_PROCESSOR, description="what it computes on: see common/host.py")
    rewards: dict[int, Reward] = Field(
        default_factory=dict, description="of round 0 of the arm that `stage` is of, as far as known (agents/start.py)"
    )


class RoundRequest(Header):
    """Asks for the messages of rounds `first` to `last`."""

    first: Count
    last: Count


class Acknowledgement(Header):
    """The recorder has written down what was published on `topic`."""

    topic: str
    part: str = Field("", description="of a report: which piece of which one")


class Claim(Header):
    """A process that is somebody: two cannot be the same robot."""

    agent: int = Field(ge=0)
    who: str = Field(description="random name of the process")
    holds: bool = Field(False, description="the answer of one that was there before")


class Wait(Header):
    """How a process that others wait for is, and what it waits for itself (see common/bus/patience.py)."""

    client: str = Field(max_length=100)
    asks: bool = Field(False, description="whether it wants an answer")
    what: str = Field("", max_length=MAX_TOLD, description="that it waits for; empty: it is at work")
    quiet_s: float = Field(0.0, ge=0, allow_inf_nan=False, description="for how long nothing has come of its wait")
    stage: Count = Field(0, description="that it has come to")
    round: Count = Field(0, description="of that stage's arm, that it has come to")


class Episode(Header):
    """A robot's greedy episode with the data center's model of a round (centralized learning)."""

    agent: int = Field(ge=1, le=MAX_COUNT)
    round: int = Field(ge=1, le=MAX_COUNT)
    reward: Reward


def encode_json(message: BaseModel) -> bytes:
    """A small control message."""
    return message.model_dump_json(by_alias=True).encode()


MessageT = TypeVar("MessageT", bound=BaseModel)


def decode_json(payload: Payload, kind: type[MessageT], limit_bytes: int = MAX_HEADER_BYTES) -> MessageT:
    """Read a small control message.

    Raises:
        PayloadError: not JSON, or not of that kind.
    """
    if len(payload) > limit_bytes:
        raise PayloadError(f"{kind.__name__}: {len(payload)} bytes, expected at most {limit_bytes}")
    try:
        return kind.model_validate_json(bytes(payload))
    except ValidationError as error:
        raise PayloadError(f"{kind.__name__}: {first_reason(error)}") from error


def in_pieces(rows: Iterable[MessageT], limit_bytes: int) -> Iterator[list[MessageT]]:
    """Rows in their order, in lists of `limit_bytes` as JSON at most, or of one row; one list at least."""
    piece: list[MessageT] = []
    used_bytes = 0
    for row in rows:
        row_bytes = len(row.model_dump_json().encode()) + 1
        if piece and used_bytes + row_bytes > limit_bytes:
            yield piece
            piece, used_bytes = [], 0
        piece.append(row)
        used_bytes += row_bytes
    yield piece
