"""Where a meter of a training loop puts its rows: a CSV file that several meters may share."""

from __future__ import annotations

import csv
import errno
import fcntl
import io
import os
from collections.abc import Sequence
from pathlib import Path

from jouleswarm.common.errors import ConfigurationError

COLUMNS = ("arm", "phase", "task", "robot", "to", "what", "value", "end", "activity", "round", "how")
COUNTS = "counts.csv"
"""In the run directory of a meter that counts in this form, in place of `meter.jsonl`."""
_HEAD = f"{','.join(COLUMNS)}\n".encode()

Rows = Sequence[tuple[object, ...]]
"""A cell a column."""


class CountsFile:
    """Appends to one; what is in it stays."""

    def __init__(self, path: Path, name: str) -> None:
        """
        Raises:
            ConfigurationError: it is no meter's, or cannot be written; `name` is whose it is.
        """
        self._path, self._name = path, name
        try:
            self.put([])
        except OSError as error:
            raise ConfigurationError(f"meter {name}: cannot write {path} ({error.strerror})") from error

    def put(self, rows: Rows, *, wait: bool = True) -> bool:
        """Write them, which is always done at once.

        Raises:
            OSError: none of them can be written.
        """
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        with self._path.open("a+b", buffering=0) as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            if (head := file.read(len(_HEAD))) not in (b"", _HEAD):
                raise ConfigurationError(f"meter {self._name}: {self._path} is not a meter's file, expected a new one")
            data, size = (b"" if head else _HEAD) + text.getvalue().encode(), file.seek(0, os.SEEK_END)
            if file.write(data) != len(data):  # a full disk: rather no rows than half of one
                file.truncate(size)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))
        return True

    def forked(self) -> None:
        """The same file serves a child."""

    def close(self) -> Rows:
        """Nothing is left that could not be written."""
        return ()


def check_word(word: str) -> None:
    """
    Raises:
        ConfigurationError: a name that cannot stand in the file.
    """
    if not 0 < len(word) <= 100 or not word.isprintable() or word.strip(" #") != word:
        raise ConfigurationError(f"meter: name {word!r:.120}, expected 1 to 100 printable letters without # at an end")
