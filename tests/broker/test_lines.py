"""The line that a broker prints now and then."""

from jouleswarm.broker.lines import line
from jouleswarm.broker.meter import LinkKey
from jouleswarm.common.wire.topics import Link


def test_the_line_tells_what_was_delivered_over_each_link_runs_and_clients_together() -> None:
    totals = {
        LinkKey("r", "fl", Link.SIDELINK, "out", "agent-1"): (2, 300_000, 0),
        LinkKey("r", "fl", Link.SIDELINK, "out", "agent-2"): (1, 150_000, 0),
        LinkKey("r", "fl", Link.SIDELINK, "in", "agent-2"): (9, 900_000, 0),
        LinkKey("s", "maml", Link.UPLINK, "out", "datacenter"): (7, 2_000_000, 0),
    }
    told = line(3, totals.items())
    assert told == "3 clients; delivered so far: sidelink 0.5 MB in 3 messages, uplink 2.0 MB in 7 messages"
    assert line(0, ()) == "0 clients; delivered so far: nothing"
