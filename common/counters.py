"""Counters that a killed process leaves whole: in a file that is mapped into memory, so that counting costs no call.

What was counted before a kill -9 is in the file, because the pages are the kernel's. Only a power failure can lose
the newest counts.
"""

from __future__ import annotations

import json
import mmap
from collections.abc import Iterator
from pathlib import Path

from common.lines import whole_lines

Key = tuple[str, str, str]
Cell = list[int] | memoryview
"""Three numbers that are added to in place."""

_CELL = 3
_CELL_BYTES = 8 * _CELL
_CELLS_A_FILE = 4096


class Counters:
    """Cells by key, in memory or (with `folder`) in files that the next process with this folder goes on from."""

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._cells: dict[Key, Cell] = {}
        self._maps: list[mmap.mmap] = []
        self._used = 0  # cells that the files hold, with those that were forgotten
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            for key in _read_keys(self._keys):
                if any(cell := self._new_cell()):  # zeros: never counted, or forgotten
                    self._cells[key] = cell

    def cell(self, key: Key) -> Cell:
        """The cell of a key; zeros the first time."""
        found = self._cells.get(key)
        if found is None:
            found = self._cells[key] = self._new_cell()
            if self._folder is not None:
                with self._keys.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(key) + "\n")
        return found

    def forget(self, beginning: str) -> None:
        """Have no more cells whose topic begins so. In files they stay, as zeros, until the files go."""
        for key in [key for key in self._cells if key[1].startswith(beginning)]:
            cell = self._cells.pop(key)
            for place in range(_CELL):
                cell[place] = 0

    def __len__(self) -> int:
        """Number of cells."""
        return len(self._cells)

    def __contains__(self, key: Key) -> bool:
        return key in self._cells

    def items(self, beginning: str = "") -> Iterator[tuple[Key, tuple[int, int, int]]]:
        """All cells whose topic (the key's second part) begins so, in the order of their keys."""
        for key in sorted(key for key in self._cells if key[1].startswith(beginning)):
            cell = self._cells[key]
            yield key, (cell[0], cell[1], cell[2])

    def flush(self) -> None:
        """Have the counts on the disk."""
        for each in self._maps:
            each.flush()

    @property
    def _keys(self) -> Path:
        assert self._folder is not None
        return self._folder / "counters.keys"

    def _new_cell(self) -> Cell:
        if self._folder is None:
            return [0] * _CELL
        place, at = divmod(self._used, _CELLS_A_FILE)
        self._used += 1
        if place == len(self._maps):
            self._maps.append(_mapped(self._folder / f"counters-{place}.bin"))
        return memoryview(self._maps[place]).cast("q")[at * _CELL : (at + 1) * _CELL]


def read_counters(folder: Path) -> dict[Key, tuple[int, int, int]]:
    """What a process that may still run, or was killed, has counted so far; nothing is changed."""
    if not (folder / "counters.keys").exists():
        return {}
    keys = _read_keys(folder / "counters.keys", mend=False)
    files = sorted(folder.glob("counters-*.bin"), key=lambda path: int(path.stem.removeprefix("counters-")))
    numbers = memoryview(b"".join(path.read_bytes() for path in files)).cast("q")
    return {
        key: (numbers[i * _CELL], numbers[i * _CELL + 1], numbers[i * _CELL + 2])
        for i, key in enumerate(keys)
        if (i + 1) * _CELL <= len(numbers)
    }


def _mapped(path: Path) -> mmap.mmap:
    with path.open("a+b") as file:
        file.truncate(_CELLS_A_FILE * _CELL_BYTES)
        return mmap.mmap(file.fileno(), _CELLS_A_FILE * _CELL_BYTES)


def _read_keys(path: Path, *, mend: bool = True) -> list[Key]:
    """Keys in the order of their cells; a torn one had no cell yet."""
    parts = [json.loads(line) for line in whole_lines(path, mend=mend)]
    return [(client, topic, direction) for client, topic, direction in parts]
