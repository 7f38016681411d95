"""A run in MLflow while it goes on: `--mlflow`. All that waits for its server is in a thread of its own, for a server
that is slow or gone must not hold up a run, let alone end one."""

from __future__ import annotations

import importlib.metadata
import queue
import threading
from typing import NamedTuple

from rich.console import Console

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.report.mlflow import Store, check_installed
from jouleswarm.report.scalars import Growing, Heard, Scalar
from jouleswarm.runs.run import Run

_EVERY_S = 1.0
_LAST_WAIT_S = 30.0


class _Told(NamedTuple):
    arm: str
    scalar: Scalar


class LiveRuns:
    """A follower (see fleet/following.py)."""

    def __init__(self, uri: str) -> None:
        """
        Raises:
            ConfigurationError: MLflow is not installed.
        """
        check_installed("--mlflow")
        self._uri = uri
        self._queue: queue.SimpleQueue[_Told] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._status = "KILLED"
        self._thread: threading.Thread | None = None

    def begin(self, console: Console, scenario: Scenario, recorder: Heard) -> None:
        self._console, self._scenario, self._run = console, scenario, recorder.run
        self._growing = Growing(scenario, recorder.spent)
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def take(self, row: RoundRow) -> None:
        for arm, scalar in self._growing.take(row):
            self._queue.put(_Told(arm, scalar))

    def update(self) -> None:
        pass

    def end(self, run: Run) -> None:
        for arm, scalar in self._growing.end(run):
            self._queue.put(_Told(arm, scalar))
        self._status = "FINISHED"

    def close(self) -> None:
        self._closing.set()
        if self._thread is not None:
            self._thread.join(_LAST_WAIT_S)
            if self._thread.is_alive():
                self._give_up(f"no answer for {_LAST_WAIT_S:.0f} s")

    def _work(self) -> None:
        from mlflow.exceptions import MlflowException  # takes seconds

        try:
            store = Store(self._uri, self._scenario, self._run)
            logged = store.known()
            version = importlib.metadata.version("jouleswarm")
            for arm in self._scenario.arm_names:
                if arm in logged:
                    store.go_on(logged[arm])
                else:
                    logged[arm] = store.begin(arm, version)
            is_last = False
            while not is_last:
                is_last = self._closing.wait(_EVERY_S)
                for arm, series in self._waiting().items():
                    store.add(logged[arm], series)
            for each in logged.values():
                store.end(each, self._status)
        except (MlflowException, OSError) as error:
            self._give_up(str(error).partition("\n")[0] or type(error).__name__)

    def _waiting(self) -> dict[str, list[Scalar]]:
        found: dict[str, list[Scalar]] = {}
        while not self._queue.empty():
            told = self._queue.get()
            found.setdefault(told.arm, []).append(told.scalar)
        return found

    def _give_up(self, why: str) -> None:
        self._console.print(
            f"MLflow at {self._uri}: {why}; the run goes on without. Afterwards: jouleswarm export RUN --to mlflow "
            f"--uri {self._uri}",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
