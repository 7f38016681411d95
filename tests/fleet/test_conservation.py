"""What broker and clients have counted, held together."""

from __future__ import annotations

import pytest

from common.meter import Meter, MeterRow
from fleet.conservation import conservation

WEIGHTS = "jouleswarm/r/fl/sl/1/2/weights"
PRESENCE = "jouleswarm/r/all/ctl/1/1/presence"


def counted(topic: str = WEIGHTS, client: str = "agent-1", **messages: int) -> list[MeterRow]:
    """Rows of 10-byte messages: delivered, acked, received, repeated."""
    broker, own = Meter("broker"), Meter("client")
    for _ in range(messages.get("delivered", 0)):
        broker.count(client, topic, "out", 10, 50)
    for _ in range(messages.get("acked", 0)):
        broker.count(client, topic, "acked", 10, 50)
    for _ in range(messages.get("received", 0)):
        own.count(client, topic, "in", 10, 50)
    for _ in range(messages.get("repeated", 0)):
        own.count(client, topic, "repeated", 10, 50)
    own.count(client, "jouleswarm/r/all/ctl/1/9/presence", "out", 1, 40)  # it has told its counters
    return [*broker.rows(), *own.rows()]


def test_without_faults_nothing_is_lost_and_nothing_comes_twice() -> None:
    found = conservation(counted(delivered=3, acked=3, received=3))
    assert found is not None
    assert (found.broken, found.lost, found.repeated) == ((), (0, 0), (0, 0))


def test_what_was_written_to_a_broken_connection_is_lost_and_what_came_twice_is_repeated() -> None:
    found = conservation(counted(delivered=5, acked=2, received=4, repeated=1))
    assert found is not None
    assert (found.broken, found.lost, found.repeated) == ((), (1, 10), (1, 10))


@pytest.mark.parametrize("wrong", [{"delivered": 2, "received": 3}, {"delivered": 3, "received": 1, "acked": 2}])
def test_more_received_than_delivered_or_acknowledged_than_received_is_a_defect(wrong: dict[str, int]) -> None:
    found = conservation(counted(**wrong))
    assert found is not None
    (broken,) = found.broken
    assert (broken.client, broken.topic) == ("agent-1", WEIGHTS)


def test_a_refused_second_process_may_have_heard_the_names_own_presence() -> None:
    found = conservation(counted(PRESENCE, delivered=3, received=2, acked=3))
    assert found is not None
    assert found.broken == ()
    other = conservation(counted(PRESENCE, client="agent-2", delivered=3, received=2, acked=3))
    assert other is not None
    assert len(other.broken) == 1


def test_onlookers_and_clients_that_told_nothing_are_left_out() -> None:
    silent = [row for row in counted(client="agent-2", delivered=1) if row.side == "broker"]
    found = conservation([*counted(delivered=1, received=1), *counted(client="onlooker", delivered=9), *silent])
    assert found is not None
    assert (found.broken, found.lost) == ((), (0, 0))


def test_with_one_side_only_there_is_no_balance() -> None:
    assert conservation([row for row in counted(received=1) if row.side == "client"]) is None
