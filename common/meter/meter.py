"""Byte counters, the same on both sides of the bus, and of a client's work: facts only, never prices."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal, Self, cast

from pydantic import BaseModel, ConfigDict, Field

from jouleswarm.common.meter.cells import Cell, Key
from jouleswarm.common.meter.counters import Counters, read_counters
from jouleswarm.common.meter.joule_meter import JOULES, Clock, JouleMeter
from jouleswarm.common.meter.joules import JoulesRow, joules_rows
from jouleswarm.common.meter.power import gpu, processor, told
from jouleswarm.common.meter.work import EVALUATION, WORK, Phase, Tally, WorkRow, work_keys, work_rows
from jouleswarm.common.scenario.measure import Measure
from jouleswarm.common.wire.links import link_of, phase_of
from jouleswarm.common.wire.mqtt import publish_packet_bytes
from jouleswarm.common.wire.topics import Link, arm_of

Direction = Literal["in", "out", "acked", "repeated"]
"""in, out: whole PUBLISH packets as the side sees them. acked, of the broker: those of out whose receipt the client
has acknowledged. repeated, of a client: those of in that it had already, sent again because of a fault."""
Side = Literal["broker", "client"]

log = logging.getLogger("jouleswarm.meter")


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


class Meter:
    """Counts messages, payload bytes and packet bytes per (client, topic, direction). Thread-safe.

    With a folder a process that was killed goes on counting from where it was (see `common.meter.counters`).
    """

    def __init__(self, side: Side, folder: Path | None = None, cpu_ns: Clock = time.process_time_ns) -> None:
        """`cpu_ns`: the clock of whose CPU time is this client's."""
        self._side: Side = side
        self._cpu_ns = cpu_ns
        self.energy = JouleMeter()
        """Told what the process does."""
        self._counters = Counters(folder)
        self._lock = threading.Lock()

    def count(self, client: str, topic: str, direction: Direction, payload_bytes: int, packet_bytes: int) -> None:
        """Book one PUBLISH packet; topics without a link class are not metered."""
        if link_of(topic) is None:
            return
        with self._lock:
            self._counters.cell((client, topic, direction)).add(payload_bytes, packet_bytes)

    def publish(self, client: str, topic: str, direction: Direction, payload_bytes: int, qos: int) -> None:
        """Book the PUBLISH packet that carries so many bytes at this QoS."""
        self.count(client, topic, direction, payload_bytes, publish_packet_bytes(topic, payload_bytes, qos))

    def rows(self) -> list[MeterRow]:
        """The counters as rows, in a stable order."""
        with self._lock:
            return rows_of(self._side, self._counters.items())

    def totals(self, direction: Direction) -> dict[str, int]:
        """Payload bytes so far in one direction, by link class."""
        totals = {link.value: 0 for link in Link}
        with self._lock:
            for (_, topic, counted), (_, payload_bytes, _) in self._counters.items():
                if counted == direction:
                    totals[str(link_of(topic))] += payload_bytes
        return totals

    def tally(self, phase: Phase, arm: str, task: int) -> Tally:
        """Where the process books what it computes and moves there; kept as the bytes are."""
        with self._lock:
            return Tally(*map(self._counters.cell, work_keys(phase, arm, task)))

    def work(self, client: str) -> list[WorkRow]:
        """What `client`, whose meter this is, has done."""
        with self._lock:
            return work_rows(client, self._counters.items())

    def measure(self, settings: Measure, gpu_uuid: str | None = None) -> None:
        """From here on measure the joules of the calling process too, if that is wanted; and of its GPU."""
        if settings.energy:
            clocks = time.monotonic_ns, self._cpu_ns
            self.energy = JouleMeter(self._cell, processor(settings), gpu(gpu_uuid), clocks)
            log.info("%s", told(settings))

    def joules(self, client: str) -> list[JoulesRow]:
        """What `client`, whose meter this is, has measured."""
        self.energy.settle()
        with self._lock:
            return joules_rows(client, self._counters.items())

    def _cell(self, key: Key) -> Cell:
        with self._lock:
            return self._counters.cell(key)

    def flush(self) -> None:
        """Have the counts on the disk, if there is a folder."""
        self._counters.flush()


def rows_of(side: Side, items: Iterable[tuple[Key, Sequence[int]]]) -> list[MeterRow]:
    """Counted cells of bytes as rows."""
    return [
        MeterRow.of(side, client, topic, cast(Direction, direction), counts)
        for (client, topic, direction), counts in items
        if counts[0] and direction not in (WORK, EVALUATION, JOULES)
    ]


def read_rows(side: Side, folder: Path) -> list[MeterRow]:
    """The rows of a meter whose process may have been killed."""
    return rows_of(side, sorted(read_counters(folder).items()))


def read_work(client: str, folder: Path) -> list[WorkRow]:
    """What a process that may have been killed has done."""
    return work_rows(client, sorted(read_counters(folder).items()))


def read_joules(client: str, folder: Path) -> list[JoulesRow]:
    """What a process that may have been killed has measured."""
    return joules_rows(client, sorted(read_counters(folder).items()))


def received(rows: Iterable[MeterRow], side: Side) -> list[MeterRow]:
    """Rows of what subscribers got, as `side` counted it: the broker's deliveries or the clients' receipts."""
    direction = "out" if side == "broker" else "in"
    return [row for row in rows if row.side == side and row.direction == direction]
