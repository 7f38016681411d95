"""What the broker counts: every PUBLISH packet in and out, and what it refused or had to give up."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from common.meter import Direction, Meter, MeterRow, packet_bytes
from common.mqtt_client import name_of
from common.topics import Link, arm_of, link_of, run_of


class LinkKey(NamedTuple):
    """What the live totals are kept by."""

    run: str
    arm: str
    link: Link
    direction: Direction
    client: str


class BrokerMeter:
    """Wraps `Meter("broker")`: the same rows, plus running totals that are cheap to read. Thread-safe.

    `in` is a PUBLISH received whole from a client, `out` one written whole to a subscriber; a delivery that
    was cut off is booked as aborted, never as delivered. Clients go by their plain names.
    """

    def __init__(self, *, enabled: bool = True) -> None:
        self.enabled = enabled
        self.changes = 0
        self.events: Counter[str] = Counter()
        self._meter = Meter("broker")
        self._totals: dict[LinkKey, list[int]] = {}
        self._keys: dict[tuple[str, str, Direction], LinkKey | None] = {}
        self._lock = threading.Lock()

    def received(self, client_id: str, topic: str, payload_bytes: int, remaining_length: int) -> None:
        """Book a PUBLISH from a client."""
        if self.enabled:
            self._count(client_id, topic, "in", payload_bytes, packet_bytes(remaining_length))

    def delivered(self, client_id: str, topic: str, payload_bytes: int, packet_size: int) -> None:
        """Book a PUBLISH that was written whole to a subscriber."""
        if self.enabled:
            self._count(client_id, topic, "out", payload_bytes, packet_size)

    def event(self, what: str, count: int = 1) -> None:
        """Count something that is not traffic, such as a refusal."""
        with self._lock:
            self.events[what] += count

    def rows(self) -> list[MeterRow]:
        """One cumulative row for each client, topic and direction."""
        return self._meter.rows()

    def totals(self) -> dict[LinkKey, tuple[int, int, int]]:
        """(messages, payload bytes, packet bytes) for each run, arm, link, direction and client."""
        with self._lock:
            return {key: (counts[0], counts[1], counts[2]) for key, counts in self._totals.items()}

    def event_counts(self) -> dict[str, int]:
        """Refusals and the like since the start."""
        with self._lock:
            return dict(self.events)

    def _count(self, client_id: str, topic: str, direction: Direction, payload_bytes: int, size: int) -> None:
        short = (client_id, topic, direction)
        if short not in self._keys:
            self._keys[short] = _key(*short)
        key = self._keys[short]
        if key is None:
            return
        self._meter.count(key.client, topic, direction, payload_bytes, size)
        with self._lock:
            counts = self._totals.setdefault(key, [0, 0, 0])
            counts[0] += 1
            counts[1] += payload_bytes
            counts[2] += size
        self.changes += 1


def _key(client_id: str, topic: str, direction: Direction) -> LinkKey | None:
    link = link_of(topic)
    if link is None:
        return None
    return LinkKey(run_of(topic), arm_of(topic), link, direction, name_of(client_id))


def by_link(totals: Iterable[tuple[LinkKey, tuple[int, int, int]]]) -> dict[Link, dict[str, dict[str, int]]]:
    """Totals summed over runs, arms and clients: link -> direction -> messages, payload and packet bytes."""
    sums: dict[Link, dict[str, dict[str, int]]] = {}
    for key, counts in totals:
        into = sums.setdefault(key.link, {}).setdefault(
            key.direction, {"messages": 0, "payload_bytes": 0, "packet_bytes": 0}
        )
        for name, count in zip(into, counts, strict=True):
            into[name] += count
    return sums
