"""What processes tell the recorder: rows of the run log, learned models, and their final byte counters.

Rows go out as they are made, for who watches; that they are all written down is sure only by the report at the end,
which holds them all and is sent until the recorder has acknowledged it. Without a recorder nobody waits for one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from common import topics
from common.bus import Message, Payload
from common.lines import whole_lines
from common.listener import Listener
from common.meter import MeterRow
from common.payloads import Acknowledgement, Count, Presence, decode_json, encode_json
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
    """A client's counters and rows at its end."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    client: str = Field(max_length=100)
    rows: list[MeterRow]
    rounds: list[RoundRow]


class Reporter:
    """A process's line to the recorder."""

    def __init__(self, listener: Listener, run: str, rows: Path | None = None) -> None:
        """`rows`: a file that keeps the rows, for a process that was killed."""
        self._listener, self._bus, self._run, self._file = listener, listener.bus, run, rows
        self._lines: list[bytes] = []  # where there is no file
        if rows is not None:
            whole_lines(rows)
        self._acknowledged: set[str] = set()
        self._recorded = False
        listener.handlers |= {"ack": self._take_acknowledgement, "here": self._take_recorder}
        self._bus.subscribe(topics.recorder(run), topics.acknowledgement(run, self._bus.client))

    def row(self, row: RoundRow) -> None:
        """Tell a row, and keep it for the end."""
        line = row.model_dump_json().encode()
        if self._file is None:
            self._lines.append(line)
        else:
            with self._file.open("ab") as file:
                file.write(line + b"\n")
        received = {Link(link): count for link, count in self._bus.meter.totals("in").items()}
        telemetry = Telemetry(row=row, received=received)
        self._bus.publish(topics.telemetry(self._run, row.arm, self._bus.client), encode_json(telemetry))

    def deliver(self, topic: str, payload: Payload) -> None:
        """Give the recorder, if there is one, something that it must not miss."""
        self._acknowledged.discard(topic)

        def send() -> None:
            self._bus.publish(topic, payload)

        send()
        self._listener.until(lambda: self._is_known(topic), lambda: f"the recorder to take {topic}", send)

    def leave(self, filters: Sequence[str], presence: str) -> None:
        """Hear nothing more, then hand in rows and byte counters, final from there on, and disconnect."""
        if filters:
            self._bus.unsubscribe(*filters)
        self._bus.publish(presence, b"", retain=True)
        self._bus.flush()
        # From here on nothing comes that is metered, but acknowledgements that the report cannot hold anyway.
        topic = topics.meter_report(self._run, self._bus.client)
        lines = self._lines if self._file is None else whole_lines(self._file)
        report = MeterReport(client=self._bus.client, rows=self._bus.meter.rows(), rounds=_once(lines))
        self.deliver(topic, encode_json(report))
        self._bus.close()

    def _is_known(self, topic: str) -> bool:
        return topic in self._acknowledged or not self._recorded

    def _take_acknowledgement(self, message: Message) -> None:
        self._acknowledged.add(decode_json(message.payload, Acknowledgement).topic)

    def _take_recorder(self, message: Message) -> None:
        self._recorded = bool(message.payload) and decode_json(message.payload, Presence).state == "here"


def _once(lines: Iterable[bytes]) -> list[RoundRow]:
    """Rows, each once: a process that was killed tells its last row again."""
    rows = map(RoundRow.model_validate_json, lines)
    return list({row.sort_key(): row for row in rows}.values())
