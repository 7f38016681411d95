"""What processes tell the recorder: rows of the run log, learned models, and their final byte counters.

Rows go out as they are made, for who watches; that they are all written down is sure only by the report at the end,
which holds them all and is sent until the recorder has acknowledged it. Without a recorder nobody waits for one.

A recorder that comes anew, because all was broken off and started again, has nothing of what was told before. So what
was handed in is kept beside the rows until the whole run is recorded; who has a folder to clear stays that long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from urllib.parse import quote, unquote

from pydantic import BaseModel, ConfigDict, Field

from common import topics
from common.bus import Message, Payload
from common.lines import whole_lines
from common.listener import Listener
from common.meter import MeterRow
from common.payloads import Acknowledgement, Count, Presence, decode_json, encode_json
from common.runlog import RoundRow
from common.state import write_whole
from common.topics import Link

MAX_REPORT_BYTES = 16 * 1024 * 1024
"""Counters by topic: 200 to 300 bytes a row, so some 60 000 rows."""


HANDED_IN = ".handed-in"
"""Ending of a file with what was handed in, named after its topic; `RECORDED_BY` is one that says that a recorder was
heard of."""
RECORDED_BY = "recorder" + HANDED_IN


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
            rows.parent.mkdir(parents=True, exist_ok=True)
            whole_lines(rows)
        self._acknowledged: set[str] = set()
        self._recorded = False  # by one that is there
        self._is_over = False
        self.has_recorder = rows is not None and (rows.parent / RECORDED_BY).exists()
        """Whether the run has, or had, a recorder."""
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
        if self._file is not None:
            name = quote(topic.split("/", 2)[2], safe="") + HANDED_IN  # without root and run
            write_whole(self._file.parent / name, payload, durable=False)
        self._deliver(topic, payload)

    def hand_over(self, filters: Sequence[str], presence: str, done: Presence, *, stay: bool) -> None:
        """Hear nothing more, then hand in rows and byte counters, final from there on.

        `done`: what stays at `presence`, while there is a recorder, for those who come back; who is to `stay` until it
        has the whole run, and to hand in again to one that comes anew, is still here.
        """
        if filters:
            self._bus.unsubscribe(*filters)
        word = done.model_copy(update={"state": "here"}) if stay else done
        self._bus.publish(presence, encode_json(word) if self.has_recorder else b"", retain=True)
        self._bus.flush()
        # From here on nothing comes that is metered, but acknowledgements that the report cannot hold anyway.
        self._hand_in()
        while stay and self.has_recorder and not self._is_over:
            self._await_recorder(lambda: self._is_over or self._misses_something(), "the whole run to be recorded")
            if not self._is_over:
                self._hand_in()

    def leave(self, presence: str) -> None:
        """Disconnect; when the whole run is recorded there is no more to say."""
        if self._is_over:
            self._bus.publish(presence, b"", retain=True)
        self._bus.close()

    def _hand_in(self) -> None:
        """Give the recorder all that it has not acknowledged to this process, the report at last."""
        kept = sorted(self._file.parent.glob(f"*%2F*{HANDED_IN}")) if self._file is not None else ()
        for path in kept:
            topic = f"{topics.ROOT}/{self._run}/{unquote(path.name.removesuffix(HANDED_IN))}"
            if topic not in self._acknowledged:
                self._deliver(topic, path.read_bytes())
        lines = self._lines if self._file is None else whole_lines(self._file)
        report = MeterReport(client=self._bus.client, rows=self._bus.meter.rows(), rounds=_once(lines))
        self._deliver(topics.meter_report(self._run, self._bus.client), encode_json(report))

    def _deliver(self, topic: str, payload: Payload) -> None:
        self._acknowledged.discard(topic)

        def send() -> None:
            self._bus.publish(topic, payload)

        send()
        self._await_recorder(lambda: self._is_known(topic), f"the recorder to take {topic}", send)

    def _await_recorder(
        self, condition: Callable[[], bool], what: str, ask_again: Callable[[], None] | None = None
    ) -> None:
        self._listener.until(condition, lambda: what, ask_again, whom=lambda: [topics.RECORDER])

    def _misses_something(self) -> bool:
        return self._recorded and topics.meter_report(self._run, self._bus.client) not in self._acknowledged

    def _is_known(self, topic: str) -> bool:
        return topic in self._acknowledged or not self._recorded

    def _take_acknowledgement(self, message: Message) -> None:
        self._acknowledged.add(decode_json(message.payload, Acknowledgement).topic)

    def _take_recorder(self, message: Message) -> None:
        state = decode_json(message.payload, Presence).state if message.payload else "gone"
        self._recorded, self._is_over = state == "here", state == "done"
        if self._recorded:
            self.has_recorder = True
            if self._file is not None:
                (self._file.parent / RECORDED_BY).touch()
        else:
            self._acknowledged.clear()  # one that comes may be another


def _once(lines: Iterable[bytes]) -> list[RoundRow]:
    """Rows, each once: a process that was killed tells its last row again."""
    rows = map(RoundRow.model_validate_json, lines)
    return list({row.sort_key(): row for row in rows}.values())
