"""Counters that a killed process leaves whole: in a file that is mapped into memory, so that counting costs no call.

What was counted before a kill -9 is in the file, because the pages are the kernel's. Only a power failure can lose
the newest counts.
"""

from __future__ import annotations

import json
import mmap
from collections.abc import Iterator
from pathlib import Path

from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.trouble import allocate, disk_error
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.cells import CELL, PLACE, Cell, Counts, KeptCell, Key, counts_at, salt_of

_CELLS_A_FILE = 4096
_CELL_BYTES = 8 * CELL
_FILE_BYTES = _CELLS_A_FILE * _CELL_BYTES
_READS = 20


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
        return KeptCell(memoryview(self._maps[place]).cast("q")[at * CELL : (at + 1) * CELL], key, counts)


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
    if len(keys) * CELL > len(numbers):
        raise RunError(f"{folder / f'counters-{len(files)}.bin'}: gone; {_ANEW}")
    for start in range(len(keys) * CELL, len(numbers), PLACE):
        if numbers[start]:
            raise RunError(f"{folder / KEYS}: cut short, there are counters without a key; {_ANEW}")
    cells = [numbers[start : start + CELL] for start in range(0, len(keys) * CELL, CELL)]
    return [
        (key, _counts(cell, key, files[index // _CELLS_A_FILE]))
        for index, (key, cell) in enumerate(zip(keys, cells, strict=True))
    ]


_ANEW = "counted bytes are lost, so begin the run anew"


def _counts(numbers: memoryview, key: Key, file: Path) -> Counts:
    """Those of a cell: of its two places the newer one that was written to its end."""
    found = [counts_at(numbers, at, salt_of(key)) for at in (0, PLACE)]
    whole = [counts for counts in found if counts is not None]
    if not whole or any(counts is None and numbers[at + 3] for counts, at in zip(found, (0, PLACE), strict=True)):
        raise RunError(f"{file}: not as it was written (the counter of {' '.join(key)}); {_ANEW}")
    return max(whole)


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
