"""What broker and clients have counted, held together."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.meter.meter import Meter, MeterRow
from jouleswarm.runs.conservation import Balance, conservation

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
    center = conservation(
        counted("jouleswarm/r/all/ctl/0/0/presence", client="datacenter", delivered=2, received=1, acked=2)
    )
    assert center is not None
    assert center.broken == ()
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


@pytest.mark.parametrize(
    ("delivered", "received", "acknowledged"),
    [
        ((6, 1000), (5, 5000), (5, 5000)),  # more bytes received than delivered, in fewer messages
        ((5, 6000), (6, 5000), (5, 5000)),  # more messages received than delivered, in fewer bytes
        ((6, 6000), (6, 1000), (5, 5000)),  # more bytes acknowledged than received, in fewer messages
    ],
)
def test_neither_messages_nor_bytes_make_up_for_the_other(
    delivered: tuple[int, int], received: tuple[int, int], acknowledged: tuple[int, int]
) -> None:
    assert not Balance("agent-1", WEIGHTS, delivered, acknowledged, received).holds


COUNTS = st.tuples(st.integers(0, 9), st.integers(0, 9))


@given(delivered=COUNTS, received=COUNTS, acknowledged=COUNTS)
def test_the_balance_holds_in_messages_and_in_bytes_or_not_at_all(
    delivered: tuple[int, int], received: tuple[int, int], acknowledged: tuple[int, int]
) -> None:
    in_messages, in_bytes = (acknowledged[i] <= received[i] <= delivered[i] for i in (0, 1))
    balance = Balance("agent-1", WEIGHTS, delivered, acknowledged, received)
    assert balance.holds == (in_messages and in_bytes)
    if balance.holds:
        assert min(balance.lost) >= 0
