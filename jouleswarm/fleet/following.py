"""Who is told of a run while it goes on, beside the view on the screen: Prometheus, TensorBoard, MLflow."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

from rich.console import Console

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.fleet.recording import View, Viewing
from jouleswarm.runs.run import Run, load_run


class Follower(Protocol):
    """None of these may end a run: what fails is told in one line."""

    def begin(self, console: Console, scenario: Scenario, recorder: Recorder) -> None:
        """The recorder listens."""

    def take(self, row: RoundRow) -> None:
        """A row has come; must be quick."""

    def update(self) -> None:
        """Called again and again while the run goes on; must be quick."""

    def end(self, run: Run) -> None:
        """It is complete and written down."""

    def close(self) -> None:
        """Nothing more will come, however the run ended."""


class Following:
    """All followers of a run, one after the other."""

    def __init__(self, followers: Sequence[Follower]) -> None:
        self._followers = followers

    def beside(self, viewing: Viewing) -> Viewing:
        """A view that tells the followers too."""

        @contextlib.contextmanager
        def both(console: Console, scenario: Scenario, recorder: Recorder) -> Iterator[View]:
            for each in self._followers:
                each.begin(console, scenario, recorder)
            recorder.on_row = self._take
            with viewing(console, scenario, recorder) as view:
                yield _All([*self._followers, view])

        return both if self._followers else viewing

    def _take(self, row: RoundRow) -> None:
        for each in self._followers:
            each.take(row)

    def end(self, path: Path) -> None:
        """The run directory has all."""
        if self._followers:
            run = load_run(path)
            for each in self._followers:
                each.end(run)


@contextlib.contextmanager
def following(followers: Sequence[Follower]) -> Iterator[Following]:
    """Closes them all at the end."""
    with contextlib.ExitStack() as stack:
        for each in followers:
            stack.callback(each.close)
        yield Following(followers)


class _All:
    def __init__(self, views: Sequence[Follower | View]) -> None:
        self._views = views

    def update(self) -> None:
        for each in self._views:
            each.update()
