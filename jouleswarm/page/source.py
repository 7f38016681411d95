"""Where the page's facts come from: a run directory that is there already, or grows."""

from __future__ import annotations

import datetime
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from jouleswarm.common.disk.lock import is_held
from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.page.milestones import milestones
from jouleswarm.page.model import Shown, shown
from jouleswarm.page.paths import Paths
from jouleswarm.runs.directory import MANIFEST, ROUNDS, TIMES
from jouleswarm.runs.events import EVENTS, read_events
from jouleswarm.runs.files import read_lines
from jouleswarm.runs.metering import RowTime
from jouleswarm.runs.run import Run, load_run

_REST = 4.0
"""A long run is read again after so many times what reading it took: the page leaves the cores to the run."""


T = TypeVar("T")
_Told = TypeVar("_Told", covariant=True)


class Source(Protocol[_Told]):
    """What the page is of."""

    @property
    def title(self) -> str:
        """Before anything is known."""

    @property
    def where(self) -> str:
        """The run, as `jouleswarm report` takes it; "" where there is no directory."""

    def look(self) -> _Told | None:
        """What there is by now, or None as long as there is nothing; often the same object as before."""


class Anew(Generic[T]):
    """What was read of a directory: again when it has changed, a long one seldom."""

    def __init__(self, read: Callable[[bool], T]) -> None:
        """`read`: with whether it is being written."""
        self._read = read
        self._found: T | None = None
        self._seen: object = None
        self._next_s = 0.0

    def look(self, seen: object, *, held: bool) -> T | None:
        """`seen`: differs when it is to be read again; `held`: it is being written, and a file that is just being
        replaced is read the next time."""
        if seen == self._seen or time.monotonic() < self._next_s:
            return self._found
        began_s = time.monotonic()
        try:
            self._found, self._seen = self._read(held), seen
        except (JouleSwarmError, FileNotFoundError):
            if not held:
                raise
        finally:
            self._next_s = time.monotonic() + _REST * (time.monotonic() - began_s)
        return self._found


class Folder:
    """A run directory, which may be written while it is read, or not be there yet."""

    def __init__(self, path: Path, now: Callable[[], datetime.datetime] | None = None) -> None:
        self.path, self.title, self.where = path, path.name, str(path)
        self._now = now or (lambda: datetime.datetime.now(datetime.UTC))
        self._paths = Paths(path)
        self._anew = Anew(lambda held: self._show(load_run(path), held))
        self._bare: Shown | None = None
        self._found: Shown | None = None

    def look(self) -> Shown | None:
        """Reads again what has grown."""
        if not (self.path / MANIFEST).exists():
            return None
        held = is_held(self.path)
        seen = held, *(_size(self.path / name) for name in (ROUNDS, "summary.json", str(EVENTS)))
        clock_s = time.monotonic() if held else 0.0  # its seconds go on
        if (bare := self._anew.look((clock_s, *seen), held=held)) is not self._bare:
            self._bare = self._found = bare
        return self._with_paths()

    def _with_paths(self) -> Shown | None:
        if self._found is not None and (paths := self._paths.look(self._found.scenario)) != self._found.paths:
            self._found = replace(self._found, paths=paths)
        return self._found

    def _show(self, run: Run, held: bool) -> Shown:
        running = held and run.summary is None
        times = read_lines(self.path / TIMES, RowTime, needed=False, cut=[])
        now = self._now().timestamp() if running else max((each.time_s for each in times), default=0.0)
        began = datetime.datetime.fromisoformat(str(run.manifest["started"])).timestamp()
        events = sorted([*read_events(self.path), *milestones(run, times)], key=lambda event: event.time_s)
        return shown(run, "running" if running else run.status, max(0.0, now - began), events)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
