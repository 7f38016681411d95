"""Where the page's facts come from: a run directory that is there already, or grows."""

from __future__ import annotations

import datetime
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from jouleswarm.common.disk.lock import is_held
from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.page.model import Shown, seconds_since, shown
from jouleswarm.page.paths import Paths
from jouleswarm.runs.directory import MANIFEST, ROUNDS, TIMES
from jouleswarm.runs.events import EVENTS, read_events
from jouleswarm.runs.run import Run, load_run

_REST = 4.0
"""A long run is read again after so many times what reading it took: the page leaves the cores to the run."""


class Source(Protocol):
    """What the page is of."""

    @property
    def title(self) -> str:
        """Before anything is known."""

    def look(self) -> Shown | None:
        """What there is by now, or None as long as there is nothing; often the same object as before."""


class Folder:
    """A run directory, which may be written while it is read, or not be there yet."""

    def __init__(self, path: Path, now: Callable[[], datetime.datetime] | None = None) -> None:
        self.path, self.title = path, path.name
        self._now = now or (lambda: datetime.datetime.now(datetime.UTC))
        self._paths = Paths(path)
        self._found: Shown | None = None
        self._seen: object = None
        self._next_s = 0.0

    def look(self) -> Shown | None:
        """Reads again what has grown. A file that is just being replaced is read the next time."""
        if not (self.path / MANIFEST).exists():
            return None
        held = is_held(self.path)
        seen = held, *(_size(self.path / name) for name in (ROUNDS, "summary.json", str(EVENTS)))
        if (not held and seen == self._seen) or time.monotonic() < self._next_s:
            return self._with_paths()
        began_s = time.monotonic()
        try:
            run = load_run(self.path)
            status = "running" if held and run.summary is None else run.status
            self._found, self._seen = shown(run, status, self._seconds(run, held), read_events(self.path)), seen
        except (JouleSwarmError, FileNotFoundError):
            if not held and seen == self._seen:
                raise
            self._seen = seen
        self._next_s = time.monotonic() + _REST * (time.monotonic() - began_s)
        return self._with_paths()

    def _with_paths(self) -> Shown | None:
        if self._found is not None and (self._paths.look(self._found.scenario) or not self._found.paths):
            self._found = replace(self._found, paths=dict(self._paths.found))
        return self._found

    def _seconds(self, run: Run, held: bool) -> float:
        started = str(run.manifest["started"])
        if held and run.summary is None:
            return seconds_since(started, self._now())
        told = _last_line(self.path / TIMES)
        if told is None:
            return 0.0
        return seconds_since(started, datetime.datetime.fromtimestamp(told["time_s"], datetime.UTC))


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _last_line(path: Path) -> dict[str, float] | None:
    """The last whole line of a file of JSON lines."""
    if not path.exists():
        return None
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 4096))
        lines = file.read().rpartition(b"\n")[0].splitlines()
    found: dict[str, float] | None = json.loads(lines[-1]) if lines else None
    return found
