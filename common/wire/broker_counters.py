"""What the broker tells of itself under `$SYS/jouleswarm/`: its limits, its totals, one run's rows to who asks."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from jouleswarm.common.meter.meter import Direction, MeterRow
from jouleswarm.common.wire.topics import Link

PIECE_BYTES = 1_000_000
"""Largest message that the broker answers with; an answer that is longer comes in pieces."""


class _Told(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Traffic(_Told):
    """Summed traffic."""

    messages: int
    payload_bytes: int
    packet_bytes: int


class BrokerLimits(_Told):
    """Retained on `topics.BROKER_LIMITS` as long as the broker lives: what it takes from a client."""

    message_bytes: int = Field(gt=0)
    """Largest remaining length of a PUBLISH packet: topic and 2 bytes, at QoS 1 and 2 two more, and the payload."""


class BrokerSnapshot(_Told):
    """Retained on `topics.BROKER_METER`, each second when anything has changed; never by a broker that counts nothing.

    Totals of all runs since the broker's beginning. `refusals` are the newest, as in `CountersPiece`.
    """

    broker: str = "jouleswarm"
    sequence: int
    clients: int
    links: dict[Link, dict[Direction, Traffic]]
    events: dict[str, int]
    refusals: tuple[str, ...] = ()


class CountersRequest(_Told):
    """Asks on `topics.BROKER_METER_ASK` for the rows of one run; the answer comes on `topics.broker_answer(asked)`."""

    asked: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    run: str = Field(min_length=1, max_length=1024)


class CountersPiece(_Told):
    """A piece of the answer, not retained. The rows hold all that was received and delivered before the question.

    Pieces are numbered from 1 and come in order; one of a run that the broker knows nothing of has no rows.
    """

    asked: str
    run: str
    piece: int = Field(ge=1)
    pieces: int = Field(ge=1)
    metering: bool
    """Whether this broker counts at all."""
    rows: tuple[MeterRow, ...]
    unmetered: int = Field(0, ge=0)
    """Messages of this run that it had no room to count."""
    refusals: tuple[str, ...] = ()
    """What the broker refused or gave up, of any run: a line for each kind and client, the newest last, 20 at most."""
