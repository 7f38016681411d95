"""Byte counters, the same on both sides of the bus: facts only, never prices.

MQTT packet bytes follow MQTT 3.1.1 section 2.2: 1 + len(varint(remaining_length)) + remaining_length.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field

from common.topics import Link, arm_of, link_of, phase_of

Direction = Literal["in", "out"]
Side = Literal["broker", "client"]


class MeterRow(BaseModel):
    """Cumulative traffic of one client on one topic, in one direction as `side` sees it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    side: Side
    arm: str
    phase: str
    topic: str
    link: Link
    client: str
    direction: Direction
    messages: int = Field(ge=0)
    payload_bytes: int = Field(ge=0)
    packet_bytes: int = Field(ge=0)

    @classmethod
    def of(cls, side: Side, client: str, topic: str, direction: Direction, counts: Sequence[int]) -> Self:
        """The row of a metered topic; `counts` are messages, payload bytes and packet bytes."""
        link = link_of(topic)
        assert link is not None  # nothing else is ever counted
        return cls(
            side=side,
            arm=arm_of(topic),
            phase=phase_of(topic),
            topic=topic,
            link=link,
            client=client,
            direction=direction,
            messages=counts[0],
            payload_bytes=counts[1],
            packet_bytes=counts[2],
        )


class _Key(NamedTuple):
    client: str
    topic: str
    direction: Direction


class Meter:
    """Counts messages, payload bytes and packet bytes per (client, topic, direction). Thread-safe."""

    def __init__(self, side: Side) -> None:
        self._side: Side = side
        self._counts: dict[_Key, list[int]] = {}
        self._lock = threading.Lock()

    def count(self, client: str, topic: str, direction: Direction, payload_bytes: int, packet_bytes: int) -> None:
        """Book one PUBLISH packet; topics without a link class are not metered."""
        if link_of(topic) is None:
            return
        with self._lock:
            counts = self._counts.setdefault(_Key(client, topic, direction), [0, 0, 0])
            counts[0] += 1
            counts[1] += payload_bytes
            counts[2] += packet_bytes

    def rows(self) -> list[MeterRow]:
        """The counters as rows, in a stable order."""
        with self._lock:
            items = sorted((key, tuple(value)) for key, value in self._counts.items())
        return [MeterRow.of(self._side, key.client, key.topic, key.direction, counts) for key, counts in items]

    def totals(self, direction: Direction) -> dict[str, int]:
        """Payload bytes so far in one direction, by link class."""
        totals = {link.value: 0 for link in Link}
        with self._lock:
            for key, (_, payload_bytes, _) in self._counts.items():
                if key.direction == direction:
                    totals[str(link_of(key.topic))] += payload_bytes
        return totals


def publish_packet_bytes(topic: str, payload_bytes: int, qos: int) -> int:
    """Size of the PUBLISH packet that carries `payload_bytes` on `topic` (MQTT 3.1.1, section 3.3)."""
    return packet_bytes(2 + len(topic.encode()) + (2 if qos > 0 else 0) + payload_bytes)


def packet_bytes(remaining_length: int) -> int:
    """Size of a whole packet from its remaining length (MQTT 3.1.1, section 2.2.3)."""
    varint = 1
    while remaining_length >= 128**varint:
        varint += 1
    return 1 + varint + remaining_length


def received(rows: Iterable[MeterRow], side: Side) -> list[MeterRow]:
    """Rows of what subscribers got, as `side` counted it: the broker's deliveries or the clients' receipts."""
    direction = "out" if side == "broker" else "in"
    return [row for row in rows if row.side == side and row.direction == direction]
