"""The rows of a run in a file that others may touch: what is in it is what was written, or it is found out."""

from __future__ import annotations

import contextlib
import json
import logging
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ValidationError

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.trouble import disk_error
from jouleswarm.common.errors import RunError
from jouleswarm.common.wire.rows import RoundRow

log = logging.getLogger("jouleswarm")

Writer = tuple[str, str, int, int]
"""Arm, phase, task and agent: whose rows."""


@dataclass
class _Told:
    """What a writer has told that is in the file."""

    rows: int = 0
    newest: int = 0
    """Round."""
    checksum: int = 0
    """Sum of the lines' CRC-32, whatever their order."""
    there: bytearray = field(default_factory=bytearray)
    """By round, whether it is there."""

    def has(self, round_: int) -> bool:
        """Whether a round is there."""
        return round_ < len(self.there) and bool(self.there[round_])


class RowFile:
    """Rows as they come, each once. A row that is lost comes back with its writer's list of all (`complete`)."""

    def __init__(self, path: Path, sums: Path | None = None) -> None:
        """`sums`: where to keep what the file's checksum was after each row, so that a run can be gone on with."""
        self._path, self._sums = path, sums
        self._told: dict[Writer, _Told] = {}
        self._due: dict[Writer, tuple[int, int]] = {}  # rows ever told, and the newest round of them
        self._size_bytes = self._checksum = 0

    def go_on(self) -> None:
        """Take up what is there, as far as it is as it was written; the rest is cut off, and comes back."""
        lines = [line + b"\n" for line in whole_lines(self._path)]
        if self._sums is not None:
            sums = list(_sums(self._sums))
            for *_, writer, due in sums:
                self._due[writer] = max(self._due.get(writer, (0, 0)), due)
            lines = lines[: _as_written(lines, {(size_bytes, checksum) for size_bytes, checksum, *_ in sums})]
        if self._path.exists():
            with self._path.open("r+b") as file:
                file.truncate(sum(map(len, lines)))
        for line in lines:
            self._book(_row(line, self._path), line)
        if lost := self._lost():
            log.warning(
                "%s: %d rows are not as they were written; they are to be told again at the end", self._path, lost
            )

    def add(self, row: RoundRow) -> None:
        """Append a row; one that is there already, told again by a process that was killed, is left out.

        So is one that comes late: `complete` brings it.
        """
        if row.round > self._told.get(_whose(row), _Told()).newest:
            self._append(row)

    def complete(self, rows: Iterable[RoundRow]) -> None:
        """Append those of a process's rows that have not come or were lost; `rows` are some of them, in any order."""
        self._mend()
        for row in rows:
            if not self._told.get(_whose(row), _Told()).has(row.round):
                self._append(row)

    def lost(self) -> str:
        """How many rows had been written, are not there any more, and have not been told again; "" if none."""
        self._mend()
        whose = ", ".join(f"robot {agent} in {arm}" for arm, _, _, agent in sorted(self._lost_of()))
        return f"{self._path}: {count} rows were lost, {whose}" if (count := self._lost()) else ""

    def _lost_of(self) -> dict[Writer, int]:
        lost = {writer: rows - self._told.get(writer, _Told()).rows for writer, (rows, _) in self._due.items()}
        return {writer: rows for writer, rows in lost.items() if rows > 0}

    def _lost(self) -> int:
        return sum(self._lost_of().values())

    def rows(self) -> Iterator[RoundRow]:
        """Those written so far, in the order of the file; read again, so that memory does not grow with the rounds.

        Raises:
            RunError: one cannot be read.
        """
        for line in whole_lines(self._path, mend=False):
            yield _row(line, self._path)

    def amend(self, change: Callable[[RoundRow], RoundRow]) -> None:
        """Put each row in another form, in the same place; its writer and round stay."""
        lines = [_line(change(row)) for row in self.rows()]
        self._told.clear()
        for line in lines:
            self._book(_row(line, self._path), line)
        self._replace(lines)

    def sort(self) -> None:
        """Bring the rows into their final order, whatever came first."""
        ordered = sorted(self.rows(), key=RoundRow.sort_key)
        self._replace([_line(row) for row in ordered])

    def _mend(self) -> None:
        """Leave out the rows of each writer of whom they are not all as they were written."""
        content = self._path.read_bytes() if self._path.exists() else b""
        if (len(content), zlib.crc32(content)) == (self._size_bytes, self._checksum):
            return
        log.warning("%s was altered by somebody else; its rows are to be told again", self._path)
        found: dict[Writer, list[bytes]] = {}
        for line in content.splitlines(keepends=True):
            try:
                found.setdefault(_whose(RoundRow.model_validate_json(line)), []).append(line)
            except ValidationError:  # nobody's
                continue
        self._told = {writer: told for writer, told in self._told.items() if _is(told, found.get(writer, []))}
        self._replace([line for writer in self._told for line in found[writer]])

    def _append(self, row: RoundRow) -> None:
        line = _line(row)
        _add(self._path, line)
        self._book(row, line)
        self._note(_whose(row))

    def _book(self, row: RoundRow, line: bytes) -> None:
        whose = _whose(row)
        told = self._told.setdefault(whose, _Told())
        told.rows, told.newest = told.rows + 1, max(told.newest, row.round)
        told.checksum += zlib.crc32(line)
        told.there.extend(bytes(max(0, row.round + 1 - len(told.there))))
        told.there[row.round] = 1
        due, newest = self._due.get(whose, (0, 0))
        self._due[whose] = max(due + (row.round > newest), told.rows), max(newest, row.round)
        self._size_bytes, self._checksum = self._size_bytes + len(line), zlib.crc32(line, self._checksum)

    def _replace(self, lines: list[bytes]) -> None:
        content = b"".join(lines)
        self._size_bytes, self._checksum = len(content), zlib.crc32(content)
        for writer in self._told:
            self._note(writer)  # first: whoever is killed in between finds the file before
        write_whole(self._path, content)

    def _note(self, writer: Writer) -> None:
        if self._sums is not None:
            sums = self._size_bytes, self._checksum, writer, self._due[writer]
            _add(self._sums, json.dumps(sums).encode() + b"\n")


def _whose(row: RoundRow) -> Writer:
    return row.arm, row.phase, row.task, row.agent


def _line(row: RoundRow) -> bytes:
    return row.model_dump_json().encode() + b"\n"


def _row(line: bytes, path: Path) -> RoundRow:
    try:
        return RoundRow.model_validate_json(line)
    except ValidationError as error:
        raise RunError(f"{path}: a row is damaged: {error.errors()[0]['msg']}") from error


def _is(told: _Told, lines: list[bytes]) -> bool:
    return told.rows == len(lines) and told.checksum == sum(map(zlib.crc32, lines))


def _sums(path: Path) -> Iterator[tuple[int, int, Writer, tuple[int, int]]]:
    """Size and checksum of the file after each row, whose it was, and what the writer had told by then."""
    for line in whole_lines(path):
        # One that is none, after a power failure say, only makes fewer rows be found as they were.
        with contextlib.suppress(ValueError, TypeError):
            size_bytes, checksum, (arm, phase, task, agent), (rows, newest) = json.loads(line)
            yield size_bytes, checksum, (arm, phase, task, agent), (rows, newest)


def _as_written(lines: list[bytes], sums: set[tuple[int, int]]) -> int:
    """How many of the lines, from the first, were in the file at some time."""
    size_bytes = checksum = good = 0
    for number, line in enumerate(lines, start=1):
        size_bytes, checksum = size_bytes + len(line), zlib.crc32(line, checksum)
        if (size_bytes, checksum) in sums:
            good = number
    return good


def _add(path: Path, line: bytes) -> None:
    try:
        with path.open("ab") as file:
            file.write(line)
    except OSError as error:
        raise disk_error(path, error) from error
