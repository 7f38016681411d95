"""The file of a meter's counts: CSV rows for `jouleswarm bill`, appended whole or not at all (docs/meter_python.md)."""

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
DATA_CENTER = "datacenter"
"""As bills call who has no robot's name."""
_HEAD = f"{','.join(COLUMNS)}\n".encode()


def append(path: Path, rows: Sequence[Sequence[object]]) -> None:
    """Add rows, and make the file where there is none; several processes may do so at once.

    Raises:
        ConfigurationError: the file is another one.
        OSError: it cannot be written; then no row of these is in it.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    with path.open("a+b", buffering=0) as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        if (head := file.read(len(_HEAD))) not in (b"", _HEAD):
            raise ConfigurationError(f"meter: {path} is not a meter's file, expected a new one")
        data, size = (b"" if head else _HEAD) + text.getvalue().encode(), file.seek(0, os.SEEK_END)
        if file.write(data) != len(data):  # a full disk: rather no rows than half of one
            file.truncate(size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def check_word(word: str) -> None:
    """
    Raises:
        ConfigurationError: it cannot stand in the file.
    """
    if not 0 < len(word) <= 100 or not word.isprintable() or word.strip(" #") != word:
        raise ConfigurationError(f"meter: name {word!r:.120}, expected 1 to 100 printable letters without # at an end")
