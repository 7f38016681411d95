"""What the broker publishes about its counters on `topics.BROKER_METER`."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from common.meter import Direction, MeterRow
from common.topics import Link


class Traffic(BaseModel):
    """Summed traffic."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    messages: int
    payload_bytes: int
    packet_bytes: int


class BrokerSnapshot(BaseModel):
    """Cumulative counters of the embedded broker, as JSON and retained.

    `rows` is there only in the answer to a message on `topics.BROKER_METER_ASK`; `asked` then repeats that
    message's payload, so that who asked knows that the counters are later than the question. The snapshots
    that come by themselves (each second, when anything has changed) hold the totals by link only.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    broker: str = "jouleswarm"
    sequence: int
    metering: bool = True
    clients: int
    links: dict[Link, dict[Direction, Traffic]]
    events: dict[str, int]
    asked: str | None = None
    rows: tuple[MeterRow, ...] | None = None
