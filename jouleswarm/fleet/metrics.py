"""A run's metrics over HTTP, for Prometheus, while it goes on and until its last values were read: `--metrics-port`."""

from __future__ import annotations

import contextlib
import importlib.metadata
import threading
import time
from collections import deque
from collections.abc import Iterable

from prometheus_client import CollectorRegistry, Metric, start_http_server
from prometheus_client.registry import Collector
from rich.console import Console

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.bill import Cost
from jouleswarm.energy.facts import Counts, Phase
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.fleet.families import Costs, Done, families
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.runs.run import Run

_SHORTEST_WAIT_S, _LONGEST_WAIT_S = 15.0, 120.0


class Metrics(Collector):
    """A follower (see fleet/following.py) that serves what was so at the last `update`: scrapes have threads of their
    own."""

    def __init__(self, port: int, host: str) -> None:
        """Who looks before the run begins finds nothing.

        Raises:
            ConfigurationError: the address is in use or does not exist.
        """
        self._families: list[Metric] = []
        self._scrapes: deque[float] = deque(maxlen=2)
        self._is_over, self._is_read = False, threading.Event()
        registry = CollectorRegistry()
        registry.register(self)
        self._scrapes.clear()  # registering may look
        try:
            self._server, self._thread = start_http_server(port, addr=host, registry=registry)
        except OSError as error:
            raise ConfigurationError(
                f"--metrics-port {port} on {host}: {error.strerror}; name another, or 0 for a free one"
            ) from error
        self._server.daemon_threads = False  # type: ignore[attr-defined]  # `close` lets an answer that has begun be given
        self._url = f"http://{host}:{self._server.server_port}/metrics"

    def begin(self, console: Console, scenario: Scenario, recorder: Recorder) -> None:
        self._console, self._scenario, self._recorder = console, scenario, recorder
        self._version = importlib.metadata.version("jouleswarm")
        console.print(f"metrics of the run {self._url}", highlight=False, soft_wrap=True)
        self.update()

    def take(self, row: RoundRow) -> None:
        pass

    def update(self) -> None:
        spent = self._recorder.spent
        self._tell(spent.counts, {key: cost for key in spent.counts if (cost := spent.cost(*key)) is not None})

    def end(self, run: Run) -> None:
        """What the broker has counted in place of what was told on the way, priced as in the run's summary."""
        done: dict[tuple[str, Phase], Counts] = {}
        costs: dict[tuple[str, Phase], Cost] = {}
        for arm, facts in run.facts.items():
            done |= {(arm, "ml"): facts.counts.ml, (arm, "fl"): facts.counts.fl}
            if facts.metered and (bill := price(literal, facts, run.scenario.energy)) is not None:
                costs |= {(arm, "ml"): bill.ml, (arm, "fl"): bill.fl}
        self._tell(done, costs)
        self._is_over = True

    def close(self) -> None:
        """Once the last values have been read, where somebody reads at intervals."""
        if self._is_over and not self._is_read.is_set() and (wait_s := self._until_next_s):
            told = f"waiting for the last values to be scraped, {wait_s:.0f} s at most; Ctrl-C ends that"
            self._console.print(told, highlight=False, soft_wrap=True)
            with contextlib.suppress(KeyboardInterrupt):
                self._is_read.wait(wait_s)
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def collect(self) -> Iterable[Metric]:
        """As prometheus_client asks for."""
        is_last, found = self._is_over, self._families
        self._scrapes.append(time.monotonic())
        if is_last:
            self._is_read.set()
        return found

    @property
    def _until_next_s(self) -> float:
        if len(self._scrapes) < 2:
            return 0.0
        return min(_LONGEST_WAIT_S, max(_SHORTEST_WAIT_S, 2 * (self._scrapes[1] - self._scrapes[0])))

    def _tell(self, done: Done, costs: Costs) -> None:
        self._families = list(families(self._scenario, self._version, self._recorder, done, costs))
