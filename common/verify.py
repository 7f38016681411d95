"""Whether what is to be gone on from is as it was written, seen before anything starts."""

from __future__ import annotations

from pathlib import Path

from common.counters import KEYS, read_counters
from common.state import StateFile

_STATES = ("state.[01]", "task-*.[01]", "seals.[01]")


def check_states(folder: Path) -> None:
    """Every state in a folder and below, the files that each relies on, and all counters.

    Raises:
        RunError: something is not as it was written; names it.
    """
    for path in sorted({path.with_suffix("") for name in _STATES for path in folder.rglob(name)}):
        StateFile(path, None).load()
    for keys in sorted(folder.rglob(KEYS)):
        read_counters(keys.parent)
