"""What processes tell the recorder: rows of the run log, and their final byte counters."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from common import topics
from common.bus import Bus
from common.meter import MeterRow
from common.payloads import Count, encode_json
from common.runlog import RoundRow
from common.topics import Link

MAX_REPORT_BYTES = 16 * 1024 * 1024
"""Counters by topic: 200 to 300 bytes a row, so some 60 000 rows."""


class Telemetry(BaseModel):
    """A row, and the payload bytes that its sender had received by then, by link class."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    row: RoundRow
    received: dict[Link, Count]


class MeterReport(BaseModel):
    """A client's counters at its end."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    client: str = Field(max_length=100)
    rows: list[MeterRow]


def publish_row(bus: Bus, run: str, row: RoundRow) -> None:
    """Send one row to the recorder."""
    received = {Link(link): count for link, count in bus.meter.totals("in").items()}
    telemetry = Telemetry(row=row, received=received)
    bus.publish(topics.telemetry(run, row.arm, bus.client), encode_json(telemetry))


def leave(bus: Bus, run: str, filters: list[str], presence: str) -> None:
    """Hear nothing more, then hand in the byte counters, final from there on, and disconnect."""
    if filters:
        bus.unsubscribe(*filters)
    bus.publish(presence, b"", retain=True)
    bus.flush()
    report = MeterReport(client=bus.client, rows=bus.meter.rows())
    bus.publish(topics.meter_report(run, bus.client), encode_json(report))
    bus.close()
