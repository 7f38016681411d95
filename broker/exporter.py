"""The counters as Prometheus metrics over HTTP."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from prometheus_client import CollectorRegistry, Metric, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from jouleswarm.broker.by_rule import RuleKey
from jouleswarm.broker.core import SwarmBroker

_LABELS = ("run", "arm", "link", "direction", "client")
_COUNTERS = (
    ("messages", "PUBLISH packets"),
    ("payload_bytes", "bytes of payload"),
    ("packet_bytes", "bytes of whole MQTT packets"),
)
_REFUSED = "refused_"


class BrokerCollector(Collector):
    """Reads the broker's counters at each scrape."""

    def __init__(self, broker: SwarmBroker) -> None:
        self._broker = broker

    def collect(self) -> Iterator[Metric]:
        totals = self._broker.meter.totals()
        for index, (name, what) in enumerate(_COUNTERS):
            counter = CounterMetricFamily(
                f"jouleswarm_broker_{name}", f"{what} received (in) or delivered (out)", labels=_LABELS
            )
            for key, counts in totals.items():
                counter.add_metric([key.run, key.arm, key.link.value, key.direction, key.client], counts[index])
            yield counter
        yield from self._by_rule()
        events = CounterMetricFamily(
            "jouleswarm_broker_events", "refusals, take-overs, aborted deliveries", labels=("event",)
        )
        for event, count in self._broker.meter.event_counts().items():
            events.add_metric([event], count)
        yield events
        yield _refusals(self._broker.meter.event_counts())
        clients = len(self._broker.handlers)
        yield GaugeMetricFamily("jouleswarm_broker_clients", "clients connected now", value=clients)
        held = self._broker.budget.used_bytes
        yield GaugeMetricFamily("jouleswarm_broker_held_bytes", "bytes of messages in memory", value=held)

    def _by_rule(self) -> Iterator[Metric]:
        if (by_rule := self._broker.meter.by_rule) is None:
            return
        totals = by_rule.totals()
        for index, (name, what) in enumerate(_COUNTERS):
            counter = CounterMetricFamily(
                f"jouleswarm_broker_rule_{name}", f"{what} of each rule of --links, and of none", labels=RuleKey._fields
            )
            for key, counts in totals.items():
                counter.add_metric(list(key), counts[index])
            yield counter


def _refusals(events: Mapping[str, int]) -> Metric:
    """Named as the recorder's (jouleswarm/fleet/families.py), so that one question asks for both."""
    refused = CounterMetricFamily(
        "jouleswarm_refused_messages", "messages refused, by whom and why", labels=("by", "reason")
    )
    for event, count in events.items():
        if event.startswith(_REFUSED):
            refused.add_metric(["broker", event.removeprefix(_REFUSED)], count)
    return refused


def start_exporter(broker: SwarmBroker, host: str, port: int) -> int:
    """Serve `/metrics` from a thread of its own; gives the port, a free one for 0.

    Raises:
        OSError: the address is in use or does not exist.
    """
    registry = CollectorRegistry()
    registry.register(BrokerCollector(broker))
    server, _ = start_http_server(port, addr=host, registry=registry)
    return int(server.server_port)
