"""What processes hand in at their end, put together from its pieces."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jouleswarm.common.bus.reporter import PIECE_BYTES, MeterReport
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.joules import JoulesRow
from jouleswarm.common.meter.meter import MeterRow, read_joules, read_rows, read_work
from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.wire.rows import RoundRow

MAX_ROWS = 100_000
"""Counters of one process: what the broker keeps of all together. More of them end the run."""


class Rounds:
    """Rows of the run log, kept aside until all have come; they can be read as often as one likes."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(4 * PIECE_BYTES)  # noqa: SIM115 -- as long as it is needed

    def add(self, rows: list[RoundRow]) -> None:
        """Some more."""
        self._file.write(b"".join(row.model_dump_json().encode() + b"\n" for row in rows))

    def __iter__(self) -> Iterator[RoundRow]:
        self._file.seek(0)
        return map(RoundRow.model_validate_json, self._file)


@dataclass
class Report:
    """A client's counters, work and rows, as far as they have come."""

    rows: list[MeterRow] = field(default_factory=list)
    work: list[WorkRow] = field(default_factory=list)
    joules: list[JoulesRow] = field(default_factory=list)
    rounds: Rounds = field(default_factory=Rounds)
    pieces: set[int] = field(default_factory=set)
    last: int | None = None

    @property
    def is_whole(self) -> bool:
        """Whether all pieces have come."""
        return self.last is not None and len(self.pieces) == self.last


class HandedIn:
    """The reports of a run's processes."""

    def __init__(self) -> None:
        self.whole: dict[str, Report] = {}
        """By client."""
        self._open: dict[str, dict[str, Report]] = {}
        """By client and token: one that was killed while it handed in begins anew."""

    def take(self, piece: MeterReport) -> Rounds | None:
        """Add a piece, once; with the last one that was missing, all rows of its client.

        Raises:
            RunError: it has more counters than a process can have, or there is no space for its rows.
        """
        lives = self._open.setdefault(piece.client, {})
        report = lives.setdefault(piece.token, Report())
        if piece.piece not in report.pieces:
            report.pieces.add(piece.piece)
            report.rows += piece.rows
            report.work += piece.work
            report.joules += piece.joules
            try:
                report.rounds.add(piece.rounds)
            except OSError as error:
                where = f"in {tempfile.gettempdir()}: {error.strerror}"
                raise RunError(
                    f"the report of {piece.client} cannot be kept {where}; make space, and --resume"
                ) from error
            report.last = piece.piece if piece.last else report.last
        if len(report.rows) + len(report.work) + len(report.joules) > MAX_ROWS:
            raise RunError(f"the report of {piece.client} has over {MAX_ROWS} counters, expected one a topic it used")
        if not report.is_whole:
            return None
        rounds, report.rounds = report.rounds, Rounds()  # they are not needed for longer than to be written down
        self.whole[piece.client] = report
        del self._open[piece.client]
        return rounds

    def final(self, clients: Sequence[str], state: Path | None) -> Report:
        """What processes have counted, computed and measured; of those that handed nothing in, as far as their folders
        in `state` tell."""
        found = Report()
        for client in clients:
            kept = self.whole.get(client)
            if kept is None and state is not None:
                folder = state / client
                kept = Report(read_rows("client", folder), read_work(client, folder), read_joules(client, folder))
            if kept is not None:
                found.rows += kept.rows
                found.work += kept.work
                found.joules += kept.joules
        return found
