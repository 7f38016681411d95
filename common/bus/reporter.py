"""What processes tell the recorder: rows of the run log, learned models, and their final counters.

Rows go out as they are made, for who watches; that they are all written down is sure only by the report at the end,
which holds them all. It goes in pieces, so that no message grows with the rounds, each sent until the recorder has
acknowledged it. Without a recorder nobody waits for one.

A recorder that comes anew, because all was broken off and started again, has nothing of what was told before. So what
was handed in is kept beside the rows until the whole run is recorded; who has a folder to clear stays that long.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, pairwise
from pathlib import Path
from urllib.parse import quote, unquote

from pydantic import BaseModel, ConfigDict, Field

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.meter.joules import JoulesRow
from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.process import ROUNDS_LOG
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import (
    MAX_COUNT,
    Acknowledgement,
    Count,
    Presence,
    decode_json,
    encode_json,
    in_pieces,
)
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.told_round import round_line
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import Payload

log = logging.getLogger(ROUNDS_LOG)

PIECE_BYTES = 256 * 1024
"""What a piece of a report is filled to; one holds a row at least."""
MAX_REPORT_BYTES = 4 * PIECE_BYTES
"""The largest piece that is taken."""


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
    """A piece of a client's counters and rows at its end; a report has one at least."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    client: str = Field(max_length=100)
    token: str = Field("", max_length=100)
    """Of the report: the next life of a process that was killed while it handed one in begins another."""
    piece: int = Field(1, ge=1, le=MAX_COUNT)
    last: bool = True
    rows: list[MeterRow]
    rounds: list[RoundRow]
    work: list[WorkRow] = Field(default_factory=list)
    joules: list[JoulesRow] = Field(default_factory=list)

    @property
    def part(self) -> str:
        """What an acknowledgement names the piece by."""
        return f"{self.token}/{self.piece}"


class Reporter:
    """A process's line to the recorder."""

    def __init__(self, listener: Listener, run: str, rows: Path | None = None) -> None:
        """`rows`: a file that keeps the rows, for a process that was killed."""
        self._listener, self._bus, self._run, self._file = listener, listener.bus, run, rows
        self._lines: list[bytes] = []  # where there is no file
        if rows is not None:
            rows.parent.mkdir(parents=True, exist_ok=True)
            whole_lines(rows)
        self._acknowledged: set[tuple[str, str]] = set()
        self._parts: set[tuple[str, str]] = set()  # of the report that was handed in last
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
        log.info("%s", round_line(row, received))
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
        while self._misses_something():
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
            if (topic, "") not in self._acknowledged:
                self._deliver(topic, path.read_bytes())
        report = topics.meter_report(self._run, self._bus.client)
        self._parts.clear()
        for piece in self._pieces():
            self._parts.add((report, piece.part))
            self._deliver(report, encode_json(piece), piece.part)
            self._bus.flush()  # without a recorder as well: one piece at a time is in memory

    def _deliver(self, topic: str, payload: Payload, part: str = "") -> None:
        self._acknowledged.discard((topic, part))

        def send() -> None:
            self._bus.publish(topic, payload)

        send()
        self._await_recorder(lambda: self._is_known(topic, part), f"the recorder to take {topic}", send)

    def _await_recorder(
        self, condition: Callable[[], bool], what: str, ask_again: Callable[[], None] | None = None
    ) -> None:
        self._listener.until(condition, lambda: what, ask_again, whom=lambda: [topics.RECORDER])

    def _misses_something(self) -> bool:
        """Whether a recorder is there that has not got all from this process: another one than before."""
        return self._recorded and not self._parts <= self._acknowledged

    def _pieces(self) -> Iterator[MeterReport]:
        """The report: counters and work first, then the rows as they are read."""
        client, meter, token = self._bus.client, self._bus.meter, secrets.token_hex(8)
        told = chain(meter.rows(), meter.work(client), meter.joules(client), _once(self._told))
        pieces = in_pieces(told, PIECE_BYTES)
        for number, (held, after) in enumerate(pairwise(chain(pieces, (None,))), start=1):
            rows = {name: [row for row in held or () if isinstance(row, kind)] for name, kind in _KINDS.items()}
            yield MeterReport.model_validate(
                {"client": client, "token": token, "piece": number, "last": after is None, **rows}
            )

    def _told(self) -> Iterator[bytes]:
        """The lines of all rows that were told."""
        if self._file is None:
            yield from self._lines
        elif self._file.exists():
            with self._file.open("rb") as file:
                yield from file

    def _is_known(self, topic: str, part: str) -> bool:
        return (topic, part) in self._acknowledged or not self._recorded

    def _take_acknowledgement(self, message: Message) -> None:
        told = decode_json(message.payload, Acknowledgement)
        self._acknowledged.add((told.topic, told.part))

    def _take_recorder(self, message: Message) -> None:
        state = decode_json(message.payload, Presence).state if message.payload else "gone"
        self._recorded, self._is_over = state == "here", state == "done"
        if self._recorded:
            self.has_recorder = True
            if self._file is not None:
                (self._file.parent / RECORDED_BY).touch()
        else:
            self._acknowledged.clear()  # one that comes may be another


Row = MeterRow | WorkRow | JoulesRow | RoundRow
_KINDS: dict[str, type[Row]] = {"rows": MeterRow, "work": WorkRow, "joules": JoulesRow, "rounds": RoundRow}


def _once(told: Callable[[], Iterable[bytes]]) -> Iterator[RoundRow]:
    """Rows, each once as it was told last: a process that was killed tells its last rows again.

    `told` is read twice, so that no more of it is in memory than which line is which round's.
    """
    newest: dict[tuple[object, ...], dict[int, int]] = {}
    for number, row in enumerate(map(RoundRow.model_validate_json, told())):
        newest.setdefault(row.sort_key()[:-1], {})[row.round] = number
    for number, row in enumerate(map(RoundRow.model_validate_json, told())):
        if newest[row.sort_key()[:-1]][row.round] == number:
            yield row
