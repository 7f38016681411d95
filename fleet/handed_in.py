"""What processes hand in at their end, put together from its pieces."""

from __future__ import annotations

from dataclasses import dataclass, field

from common.errors import RunError
from common.meter import MeterRow
from common.reports import MeterReport
from common.work import WorkRow

MAX_ROWS = 100_000
"""Counters of one process: what the broker keeps of all together. More of them end the run."""


@dataclass
class Report:
    """A client's counters and work, as far as they have come; its rounds are in the run directory already."""

    rows: list[MeterRow] = field(default_factory=list)
    work: list[WorkRow] = field(default_factory=list)
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

    def take(self, piece: MeterReport) -> bool:
        """Add a piece, once; whether the report of its client is whole.

        Raises:
            RunError: it has more counters than a process can have.
        """
        lives = self._open.setdefault(piece.client, {})
        report = lives.setdefault(piece.token, Report())
        if piece.piece not in report.pieces:
            report.pieces.add(piece.piece)
            report.rows += piece.rows
            report.work += piece.work
            report.last = piece.piece if piece.last else report.last
        if len(report.rows) + len(report.work) > MAX_ROWS:
            raise RunError(f"the report of {piece.client} has over {MAX_ROWS} counters, expected one a topic it used")
        if report.is_whole:
            self.whole[piece.client] = report
            del self._open[piece.client]
        return report.is_whole
