"""What many robots need of brokers and recorders, in processes, bytes and joules. Pure.

A broker's work is that of its robots' messages and of nothing else (docs/scale.md has the figures), and sidelinks stay
within a cluster. So clusters are shared out whole among brokers that need not know each other, and all grows as the
number of robots does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from jouleswarm.common.errors import ConfigurationError


class RobotRound(NamedTuple):
    """What a robot's round costs others, as `python -m benchmarks.scale` measures it."""

    seconds: float
    """How long it takes the robot."""
    broker_s: float
    """Of a core, seconds."""
    recorder_s: float
    """Likewise."""
    wire_bytes: float
    """Into the broker and out of it: MQTT packets, whole."""


class Host(NamedTuple):
    """A core with one process, and its share of what surrounds it."""

    busy: float = 0.7
    """Share of its time that it may compute; above that rounds wait for it."""
    connections: int = 998
    """Of robots: the embedded broker's 1,000 (--max-connections) but for data center and recorder."""
    bytes_per_s: float = 125e6
    """1 Gbit/s, in and out together."""
    idle_w: float = 5.0
    """Power while it waits."""
    core_w: float = 10.0
    """On top of it while it computes."""
    pue: float = 1.67
    """Of its site, gamma in the paper."""


class Infrastructure(NamedTuple):
    """For so many robots."""

    robots_per_broker: int
    limit: str
    """What a broker has none left of first: processor, network or connections."""
    brokers: int
    recorders: int
    bytes_per_s: float
    """Through all brokers."""
    joules: float
    """Of a round, brokers and recorders, of all robots."""


def infrastructure(robots: int, cluster: int, each: RobotRound, host: Host | None = None) -> Infrastructure:
    """Brokers, recorders, bytes and joules that `robots` robots in clusters of `cluster` need.

    A process takes as many robots as it has time for, of a broker also as many as it may connect and the network
    carries, in whole clusters. Joules of a round are pue x (processes x idle_w x seconds + core_w x seconds computed).

    Raises:
        ConfigurationError: one cluster is more than a broker takes.
    """
    host = host or Host()
    time_s = host.busy * each.seconds
    limits = {
        "processor": time_s / each.broker_s,
        "network": host.bytes_per_s * each.seconds / each.wire_bytes,
        "connections": float(host.connections),
    }
    limit = min(limits, key=limits.__getitem__)
    per_broker, per_recorder = (
        cluster * math.floor(most / cluster) for most in (limits[limit], time_s / each.recorder_s)
    )
    if not (per_broker and per_recorder):
        raise ConfigurationError(
            f"a cluster of {cluster} robots: got room for {limits[limit]:.3g} at a broker ({limit}) and "
            f"{time_s / each.recorder_s:.3g} at a recorder, expected it whole at one of each; take a faster host"
        )
    brokers, recorders = math.ceil(robots / per_broker), math.ceil(robots / per_recorder)
    idle_j = (brokers + recorders) * host.idle_w * each.seconds
    computing_j = robots * (each.broker_s + each.recorder_s) * host.core_w
    return Infrastructure(
        robots_per_broker=per_broker,
        limit=limit,
        brokers=brokers,
        recorders=recorders,
        bytes_per_s=robots * each.wire_bytes / each.seconds,
        joules=host.pue * (idle_j + computing_j),
    )
