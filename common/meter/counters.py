"""Counters that a killed process leaves whole: in a file that is mapped into memory, so that counting costs no call.

What was counted before a kill -9 is in the file, because the pages are the kernel's. Only a power failure can lose
the newest counts.

A cell has two places in the file, written in turn: the one that is being written is marked so, and the other holds
the counts before it. Each place has a checksum of its counts and its key, so that what is not as it was written is
refused, a file of zeros too.
"""

from __future__ import annotations

import json
import mmap
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.trouble import allocate, disk_error
from jouleswarm.common.errors import RunError

Key = tuple[str, str, str]
Counts = tuple[int, int, int]
"""Messages, payload bytes, packet bytes."""

_COUNTS = struct.Struct("<qqq")
_PLACE = 4  # numbers: three counts, and their checksum; 0 while they are written
_CELL = 2 * _PLACE
_CELL_BYTES = 8 * _CELL
_CELLS_A_FILE = 4096
_FILE_BYTES = _CELLS_A_FILE * _CELL_BYTES
_KEPT = 1 << 32  # so that no checksum is 0
_READS = 20


class Cell:
    """What one key has counted."""

    __slots__ = ("messages", "packet_bytes", "payload_bytes")

    def __init__(self, counts: Counts = (0, 0, 0)) -> None:
        self.messages, self.payload_bytes, self.packet_bytes = counts

    def add(self, payload_bytes: int, packet_bytes: int, messages: int = 1) -> None:
        """Count a message."""
        self.messages += messages
        self.payload_bytes += payload_bytes
        self.packet_bytes += packet_bytes

    def forget(self) -> None:
        """Count anew from nothing."""
        self.messages = self.payload_bytes = self.packet_bytes = 0

    @property
    def counts(self) -> Counts:
        """All three."""
        return self.messages, self.payload_bytes, self.packet_bytes


class _KeptCell(Cell):
    """One in a file."""

    __slots__ = ("_at", "_numbers", "_salt")

    def __init__(self, numbers: memoryview, key: Key, counts: Counts | None) -> None:
        """`counts`: as found in `numbers`; None: make a new one of them."""
        super().__init__(counts or (0, 0, 0))
        self._numbers, self._salt, self._at = numbers, _salt(key), 0
        if counts is None:
            for place in range(_CELL):
                numbers[place] = 0
            numbers[_PLACE - 1] = _checksum(self.counts, self._salt)
        elif _counts_at(numbers, _PLACE, self._salt) == counts:
            self._at = _PLACE

    def add(self, payload_bytes: int, packet_bytes: int, messages: int = 1) -> None:
        self.messages += messages
        self.payload_bytes += payload_bytes
        self.packet_bytes += packet_bytes
        counts = self.messages, self.payload_bytes, self.packet_bytes
        numbers, at = self._numbers, self._at ^ _PLACE
        numbers[at + 3] = 0
        numbers[at], numbers[at + 1], numbers[at + 2] = counts
        numbers[at + 3] = _checksum(counts, self._salt)
        self._at = at

    def forget(self) -> None:
        super().forget()
        # In this order: whoever is killed in between has what was counted, or nothing, and never half of it.
        numbers, at = self._numbers, self._at ^ _PLACE
        numbers[at + 3] = 0
        numbers[at], numbers[at + 1], numbers[at + 2] = self.counts
        numbers[at + 3] = _checksum(self.counts, self._salt)
        numbers[self._at + 3] = 0
        self._at = at


class Counters:
    """Cells by key, in memory or (with `folder`) in files that the next process with this folder goes on from."""

    def __init__(self, folder: Path | None = None) -> None:
        """
        Raises:
            RunError: what is in the folder is not as it was written, or there is no space for more.
        """
        self._folder = folder
        self._cells: dict[Key, Cell] = {}
        self._maps: list[mmap.mmap] = []
        self._used = 0  # cells that the files hold, with those that were forgotten
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            for key, counts in _read(folder):
                cell = self._kept(key, counts)
                if any(counts):  # else never counted, or forgotten
                    self._cells[key] = cell
            whole_lines(self._keys)

    def cell(self, key: Key) -> Cell:
        """The cell of a key; zeros the first time.

        Raises:
            RunError: there is no space for a new one.
        """
        found = self._cells.get(key)
        if found is None:
            found = self._cells[key] = Cell() if self._folder is None else self._kept(key, None)
            if self._folder is not None:
                try:
                    with self._keys.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(key) + "\n")
                except OSError as error:
                    raise disk_error(self._keys, error) from error
        return found

    def forget(self, beginning: str) -> None:
        """Have no more cells whose topic begins so. In files they stay, as zeros, until the files go."""
        for key in [key for key in self._cells if key[1].startswith(beginning)]:
            self._cells.pop(key).forget()

    def __len__(self) -> int:
        """Number of cells."""
        return len(self._cells)

    def __contains__(self, key: Key) -> bool:
        return key in self._cells

    def items(self, beginning: str = "") -> Iterator[tuple[Key, Counts]]:
        """All cells whose topic (the key's second part) begins so, in the order of their keys."""
        for key in sorted(key for key in self._cells if key[1].startswith(beginning)):
            yield key, self._cells[key].counts

    def flush(self) -> None:
        """Have the counts on the disk."""
        for each in self._maps:
            each.flush()

    @property
    def _keys(self) -> Path:
        assert self._folder is not None
        return self._folder / KEYS

    def _kept(self, key: Key, counts: Counts | None) -> Cell:
        assert self._folder is not None
        place, at = divmod(self._used, _CELLS_A_FILE)
        self._used += 1
        if place == len(self._maps):
            self._maps.append(_mapped(self._folder / f"counters-{place}.bin"))
        return _KeptCell(memoryview(self._maps[place]).cast("q")[at * _CELL : (at + 1) * _CELL], key, counts)


KEYS = "counters.keys"


def read_counters(folder: Path) -> dict[Key, Counts]:
    """What a process that may still run, or was killed, has counted so far; nothing is changed.

    Raises:
        RunError: it is not as it was written.
    """
    for left in reversed(range(_READS)):
        try:
            return {key: counts for key, counts in _read(folder) if any(counts)}
        except RunError:  # read while the process wrote?
            if not left:
                raise
    return {}


def _read(folder: Path) -> list[tuple[Key, Counts]]:
    """In the order of the cells; a key that was forgotten and came again stands twice."""
    keys = _read_keys(folder / KEYS)
    files = sorted(folder.glob("counters-*.bin"), key=lambda path: int(path.stem.removeprefix("counters-")))
    # One that was being made is shorter, and has no keys.
    written = [path.read_bytes()[:_FILE_BYTES].ljust(_FILE_BYTES, b"\0") for path in files]
    numbers = memoryview(b"".join(written)).cast("q")
    if len(keys) * _CELL > len(numbers):
        raise RunError(f"{folder / f'counters-{len(files)}.bin'}: gone; {_ANEW}")
    for start in range(len(keys) * _CELL, len(numbers), _PLACE):
        if numbers[start]:
            raise RunError(f"{folder / KEYS}: cut short, there are counters without a key; {_ANEW}")
    cells = [numbers[start : start + _CELL] for start in range(0, len(keys) * _CELL, _CELL)]
    return [
        (key, _counts(cell, key, files[index // _CELLS_A_FILE]))
        for index, (key, cell) in enumerate(zip(keys, cells, strict=True))
    ]


_ANEW = "counted bytes are lost, so begin the run anew"


def _counts(numbers: memoryview, key: Key, file: Path) -> Counts:
    """Those of a cell: of its two places the newer one that was written to its end."""
    found = [_counts_at(numbers, at, _salt(key)) for at in (0, _PLACE)]
    whole = [counts for counts in found if counts is not None]
    if not whole or any(counts is None and numbers[at + 3] for counts, at in zip(found, (0, _PLACE), strict=True)):
        raise RunError(f"{file}: not as it was written (the counter of {' '.join(key)}); {_ANEW}")
    return max(whole)


def _counts_at(numbers: memoryview, at: int, salt: int) -> Counts | None:
    counts = numbers[at], numbers[at + 1], numbers[at + 2]
    return counts if numbers[at + 3] == _checksum(counts, salt) else None


def _checksum(counts: Counts, salt: int) -> int:
    return zlib.crc32(_COUNTS.pack(*counts), salt) | _KEPT


def _salt(key: Key) -> int:
    return zlib.crc32(json.dumps(key).encode())


def _mapped(path: Path) -> mmap.mmap:
    allocate(path, _FILE_BYTES)
    with path.open("r+b") as file:
        return mmap.mmap(file.fileno(), _FILE_BYTES)


def _read_keys(path: Path) -> list[Key]:
    """Keys in the order of their cells; a torn one had no cell yet."""
    try:
        parts = [json.loads(line) for line in whole_lines(path, mend=False)]
        return [(client, topic, direction) for client, topic, direction in parts]
    except ValueError as error:
        raise RunError(f"{path}: not as it was written; {_ANEW}") from error
