"""How far a study is: a bar with the time left on a terminal, else one line a finished job."""

from __future__ import annotations

import time
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from jouleswarm.studies.jobs import Job


class Progress:
    """Context manager; `begin` once, then `ended` for every job."""

    def __init__(self, console: Console, title: str) -> None:
        self._console, self._title = console, title
        self._begun_s = time.monotonic()
        self._done = self._total = 0
        columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        # Jobs are long and few: the time left is estimated from all of them, not from the last seconds.
        self._bar = Bar(
            *columns,
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
            speed_estimate_period=24 * 3600,
        )
        self._bar_task = self._bar.add_task(title, total=None)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def begin(self, total: int, done: int) -> None:
        """There are `total` jobs, `done` of them collected before."""
        self._total, self._done = total, done
        self._bar.update(self._bar_task, total=total, completed=done)
        self._say(f"{self._title}: {total} jobs, {done} of them collected before")

    def ended(self, job: Job, error: BaseException | None) -> None:
        """A job ended, well or with an error."""
        self._done += 1
        self._bar.update(self._bar_task, advance=1)
        if error is not None:
            self._say(f"{job.name} failed: {type(error).__name__}: {error}")
        elif not self._console.is_terminal:
            self._say(f"{self._done}/{self._total} {job.name}, {time.monotonic() - self._begun_s:.0f} s")

    def _say(self, line: str) -> None:
        self._console.print(escape(line), highlight=False, soft_wrap=True)
