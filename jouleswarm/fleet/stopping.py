"""What is told when a run is stopped from outside: by Ctrl-C, SIGTERM, or SIGHUP."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Iterator
from pathlib import Path

from jouleswarm.common.invoked import executable
from jouleswarm.runs.directory import MANIFEST, ROUNDS, STATE


@contextlib.contextmanager
def telling_what_is_kept(directory: Path) -> Iterator[None]:
    """A KeyboardInterrupt says on its way what the run directory keeps, and how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"stopped: {what_is_kept(directory)}") from None


def what_is_kept(directory: Path) -> str:
    """How much of a run there is, and the command that goes on with it."""
    path = directory / ROUNDS
    rows = path.read_bytes().count(b"\n") if path.exists() else 0
    kept, folder = f"{rows} rows are kept in {directory}", shlex.quote(str(directory))
    program = executable()
    if not (directory / MANIFEST).exists():
        return f"nothing had begun; {directory} can be deleted"
    if not (directory / STATE).is_dir():
        return f"{kept}; `{program} report {folder}` shows them"
    return f"{kept}; `{program} run --resume {folder}` goes on from there"
