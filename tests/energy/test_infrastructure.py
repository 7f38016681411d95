"""What many robots need, worked out by hand."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.energy.infrastructure import Host, Infrastructure, RobotRound, infrastructure

# Half of 10 s are 5 s: 500 robots at a broker, 250 at a recorder. 10 MB/s are 100 MB a round: 1,000 robots.
ROUND = RobotRound(seconds=10, broker_s=0.01, recorder_s=0.02, wire_bytes=100e3)
HOST = Host(busy=0.5, connections=800, bytes_per_s=10e6, idle_w=5, core_w=10, pue=2)


def test_a_thousand_robots_need_two_brokers_and_five_recorders() -> None:
    assert infrastructure(1000, 4, ROUND, HOST) == Infrastructure(
        robots_per_broker=500,
        limit="processor",
        brokers=2,
        recorders=5,  # 250 robots are 62 clusters and a half: 248 each
        bytes_per_s=10e6,  # 1,000 x 100 kB in 10 s
        joules=1300,  # 7 processes x 5 W x 10 s, 1,000 x 30 ms x 10 W, and all of it twice
    )


@pytest.mark.parametrize(
    ("each", "host", "limit", "per_broker"),
    [
        (ROUND._replace(broker_s=0.001), HOST, "connections", 800),  # time for 5,000
        (ROUND._replace(broker_s=0.001), HOST._replace(connections=5000), "network", 1000),
        (ROUND._replace(wire_bytes=1e6), HOST, "network", 100),
        (ROUND._replace(broker_s=0.013), HOST, "processor", 384),  # 384.6
    ],
)
def test_a_broker_takes_what_its_scarcest_means_allow(
    each: RobotRound, host: Host, limit: str, per_broker: int
) -> None:
    found = infrastructure(1000, 4, each, host)
    assert (found.limit, found.robots_per_broker) == (limit, per_broker)


def test_a_cluster_that_no_broker_takes_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"got room for 2 at a broker \(network\) and 250 at a recorder"):
        infrastructure(1000, 4, ROUND._replace(wire_bytes=50e6), HOST)


@given(st.integers(1, 10**6), st.integers(1, 12))
def test_brokers_take_all_robots_and_none_of_them_stands_idle(robots: int, cluster: int) -> None:
    found = infrastructure(robots, cluster, ROUND, HOST)
    assert found.robots_per_broker % cluster == 0
    assert (found.brokers - 1) * found.robots_per_broker < robots <= found.brokers * found.robots_per_broker
