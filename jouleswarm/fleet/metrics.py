"""A run as Prometheus metrics over HTTP while it goes on: `--metrics-port`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from functools import partial

from prometheus_client import CollectorRegistry, Metric, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector
from rich.console import Console

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.facts import STAGE, Counts, Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.fleet.recording import View, Viewing

_HOST = "127.0.0.1"
_LINKS = ("uplink", "downlink", "sidelink")
_ALL = "all"
"""The arm of what is not known by arm until the end: the links' bytes."""


class Metrics(Collector):
    """What was so at the last `update`: scrapes come in a thread of their own."""

    def __init__(self, scenario: Scenario, recorder: Recorder) -> None:
        self._scenario, self._recorder = scenario, recorder
        self._families: list[Metric] = []
        self.update()

    def update(self) -> None:
        """Take over what the recorder knows by now."""
        self._families = list(_families(self._scenario, self._recorder))

    def collect(self) -> Iterable[Metric]:
        """As prometheus_client asks for."""
        return self._families


class _Both:
    def __init__(self, metrics: Metrics, view: View | None) -> None:
        self._metrics, self._view = metrics, view

    def update(self) -> None:
        self._metrics.update()
        if self._view is not None:
            self._view.update()


def with_metrics(port: int, viewing: Viewing | None) -> Viewing:
    """A view that serves metrics too, on 127.0.0.1; whoever looks before the run begins finds none.

    Raises:
        ConfigurationError: the port is in use.
    """
    registry = CollectorRegistry()
    try:
        server, _ = start_http_server(port, addr=_HOST, registry=registry)
    except OSError as error:
        raise ConfigurationError(
            f"--metrics-port {port}: {error.strerror}; name another, or 0 for a free one"
        ) from error
    return partial(_served, registry, server.server_port, viewing)


@contextlib.contextmanager
def _served(
    registry: CollectorRegistry,
    port: int,
    viewing: Viewing | None,
    console: Console,
    scenario: Scenario,
    recorder: Recorder,
) -> Iterator[View]:
    metrics = Metrics(scenario, recorder)
    registry.register(metrics)
    console.print(f"metrics of the run http://{_HOST}:{port}/metrics", highlight=False, soft_wrap=True)
    with contextlib.nullcontext() if viewing is None else viewing(console, scenario, recorder) as view:
        yield _Both(metrics, view)
    metrics.update()


def _families(scenario: Scenario, recorder: Recorder) -> Iterator[Metric]:
    rounds = GaugeMetricFamily("jouleswarm_round", "round of a robot", labels=("arm", "task", "robot"))
    rewards = GaugeMetricFamily("jouleswarm_reward", "R of a cluster", labels=("arm", "task"))
    for (arm, task, agent), row in recorder.newest.items():
        rounds.add_metric([arm, str(task), "datacenter" if agent == 0 else str(agent)], row.round)
        if row.phase == RowPhase.FL and row.cluster_reward is not None and agent == scenario.cluster(task)[0]:
            rewards.add_metric([arm, str(task)], row.cluster_reward)
    yield from (rounds, rewards)
    received = CounterMetricFamily("jouleswarm_received_bytes", "payload received by clients", labels=("link",))
    for link, count in recorder.received_bytes.items():
        received.add_metric([link], count)
    yield received
    joules = CounterMetricFamily(
        "jouleswarm_joules", "energy by the equations, joules; of links of all arms together", labels=("arm", "cause")
    )
    gradients = CounterMetricFamily("jouleswarm_gradients", "batch gradients computed", labels=("arm", "site"))
    for arm, counts in recorder.gradients.items():
        gradients.add_metric([arm, "datacenter"], counts.gradients_support + counts.gradients_query)
        gradients.add_metric([arm, "robots"], counts.gradients_robots)
        _add_joules(joules, arm, counts, scenario.energy)
    moved = {f"{link}_bytes": recorder.received_bytes.get(link, 0) for link in _LINKS}
    if scenario.energy.sidelink != "direct":  # they also depend on what is sent
        del moved["sidelink_bytes"]
    _add_joules(joules, _ALL, Counts(**moved), scenario.energy)
    yield from (gradients, joules)
    yield CounterMetricFamily("jouleswarm_refused_messages", "messages refused", value=recorder.refused)


def _add_joules(family: CounterMetricFamily, arm: str, counts: Counts, energy: Energy) -> None:
    with contextlib.suppress(ConfigurationError):  # told with the bill; metrics never end a run
        bill = price(literal, Facts(arm, "", t0=0, parts={("fl", STAGE): counts}), energy)
        for cause, joules in bill.both.by_cause.items() if bill else ():
            if joules:
                family.add_metric([arm, cause.key], joules)
