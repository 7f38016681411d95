"""What the meter rows of a run say was delivered to whom, by link class. Facts only, no prices."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

from jouleswarm.common.meter.meter import MeterRow, Side, received
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.topics import Link

Measure = Literal["payload", "packet"]

DATA_CENTER = "datacenter"
RECORDER = "recorder"
_ROBOT = re.compile(r"agent-\d+")


class Traffic(NamedTuple):
    """Deliveries: how many, their payload bytes and their whole MQTT packets' bytes."""

    messages: int = 0
    payload: int = 0
    packet: int = 0

    @property
    def overhead(self) -> float | None:
        """Protocol bytes per payload byte, or None where nothing was delivered."""
        return self.packet / self.payload - 1 if self.payload else None


def metered_by(meter_rows: Iterable[MeterRow]) -> Side | None:
    """Whose counters feed the bill: the broker's where there are any, else the clients', None without any."""
    sides = {row.side for row in meter_rows}
    if "broker" in sides:
        return "broker"
    return "client" if sides else None


def deliveries(
    meter_rows: Sequence[MeterRow], arm: str, link: Link, task: int | None = None, phase: str | None = None
) -> list[MeterRow]:
    """What arrived over one link class at those whom it is for; an onlooker's copies are nobody's energy.

    `task` keeps what one task's cluster learned by: its experience, weights and models; `phase` what was moved in it.
    """
    side = metered_by(meter_rows)
    if side is None:
        return []
    return [
        row
        for row in received(meter_rows, side)
        if row.arm == arm and row.link == link and _is_for(link, row.client) and _is_of(row, task)
        if phase in (None, row.phase)
    ]


def traffic(
    meter_rows: Sequence[MeterRow], arm: str, link: Link, task: int | None = None, *, phase: str | None = None
) -> Traffic:
    """Totals of `deliveries`."""
    rows = deliveries(meter_rows, arm, link, task, phase)
    return Traffic(
        sum(row.messages for row in rows),
        sum(row.payload_bytes for row in rows),
        sum(row.packet_bytes for row in rows),
    )


def sent_rows(meter_rows: Sequence[MeterRow], arm: str, task: int | None = None) -> list[MeterRow]:
    """Sidelink messages that robots sent, each once however many neighbours get it."""
    side = metered_by(meter_rows)
    direction = "in" if side == "broker" else "out"
    return [
        row
        for row in meter_rows
        if (row.side, row.direction, row.arm, row.link) == (side, direction, arm, Link.SIDELINK)
        and _ROBOT.fullmatch(row.client)
        and _is_of(row, task)
    ]


def sent_bytes(meter_rows: Sequence[MeterRow], arm: str, task: int | None, measure: Measure) -> int:
    """Bytes of `sent_rows`."""
    rows = sent_rows(meter_rows, arm, task)
    return sum(row.payload_bytes if measure == "payload" else row.packet_bytes for row in rows)


def is_party(client: str) -> bool:
    """Whether a client is one of the deployment, and no onlooker."""
    return client in (DATA_CENTER, RECORDER) or _ROBOT.fullmatch(client) is not None


def _is_for(link: Link, client: str) -> bool:
    if link == Link.UPLINK:
        return client == DATA_CENTER
    robot = _ROBOT.fullmatch(client) is not None
    return robot or (link == Link.CONTROL and client in (DATA_CENTER, RECORDER))


def _is_of(row: MeterRow, task: int | None) -> bool:
    return task is None or topics.task_of(row.topic) == str(task)
