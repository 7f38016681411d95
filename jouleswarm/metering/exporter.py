"""What a meter has counted as Prometheus metrics over HTTP."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from prometheus_client import CollectorRegistry, Metric, start_http_server
from prometheus_client.core import CounterMetricFamily
from prometheus_client.registry import Collector

from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.tally import Row
from jouleswarm.metering.cost import cost_of
from jouleswarm.metering.metered import Metered

_LABELS = ("link", "direction")
_COUNTERS = {
    "messages": "PUBLISH packets; of link control_packets, unparsed and overflow, what these count",
    "payload_bytes": "bytes of payload",
    "packet_bytes": "bytes of whole MQTT packets",
}
_KINDS = {"control": "control_packets", "unparsed": "unparsed", "overflow": "overflow"}


class MeterCollector(Collector):
    """Sums up at each scrape; links and directions are few, however many clients and topics there are."""

    def __init__(self, metered: Callable[[], Metered]) -> None:
        """`metered`: what there is by now."""
        self._metered = metered

    def collect(self) -> Iterator[Metric]:
        metered = self._metered()
        groups: dict[tuple[str, str], list[Row]] = {}
        for row in metered.rows:
            groups.setdefault((_KINDS.get(row.kind, row.link), row.direction), []).append(row)
        for name, what in _COUNTERS.items():
            counter = CounterMetricFamily(f"jouleswarm_meter_{name}", f"{what}; in: what clients send", labels=_LABELS)
            for key, rows in groups.items():
                counter.add_metric(key, sum(getattr(row, name) for row in rows))
            yield counter
        joules = CounterMetricFamily("jouleswarm_meter_joules", "what they cost at the meter's prices", labels=_LABELS)
        with contextlib.suppress(ConfigurationError):  # prices by robot, of rows that don't tell whose they are
            cost = cost_of(metered, metered.priced()[0])
            for key, rows in groups.items():
                joules.add_metric(key, cost(rows))
        yield joules


def start_exporter(metered: Callable[[], Metered], host: str | None, port: int) -> int:
    """Serve `/metrics` from a thread of its own, on every address for None; gives the port, a free one for 0.

    Raises:
        RunError: the port is in use.
    """
    registry = CollectorRegistry()
    registry.register(MeterCollector(metered))
    try:
        server, _ = start_http_server(port, addr=host or "0.0.0.0", registry=registry)
    except OSError as error:
        raise RunError(
            f"cannot serve metrics on port {port}: {error.strerror}; choose another --metrics-port"
        ) from error
    return int(server.server_port)
