"""The in-memory bus: MQTT's rules without a network."""

import threading

import pytest

from jouleswarm.common.bus.bus import MemoryHub, Message, matches
from jouleswarm.common.errors import MessageTooLargeError
from jouleswarm.common.wire import topics

WEIGHTS = topics.weights("r", "maml", 1, 1)  # jouleswarm/r/maml/sl/1/1/weights: 32 characters


@pytest.mark.parametrize(
    ("filter_", "topic", "expected"),
    [  # examples of MQTT 3.1.1, section 4.7.1
        ("sport/tennis/player1/#", "sport/tennis/player1", True),
        ("sport/tennis/player1/#", "sport/tennis/player1/ranking", True),
        ("sport/tennis/player1/#", "sport/tennis/player1/score/wimbledon", True),
        ("sport/#", "sport", True),
        ("#", "sport/tennis", True),
        ("sport/tennis/+", "sport/tennis/player1", True),
        ("sport/tennis/+", "sport/tennis/player1/ranking", False),
        ("sport/+", "sport", False),
        ("sport/+", "sport/", True),
        ("+/+", "/finance", True),
        ("/+", "/finance", True),
        ("+", "/finance", False),
        ("a/b", "a/b", True),
        ("a/b", "a/B", False),
        ("a/b", "a", False),
        ("#", "$SYS/a", False),  # 4.7.2-1
        ("+/a", "$SYS/a", False),
        ("$SYS/#", "$SYS/a", True),
    ],
)
def test_filters_match_as_the_standard_says(filter_: str, topic: str, expected: bool) -> None:
    assert matches(filter_, topic) is expected


def test_messages_come_in_the_order_they_were_published_in() -> None:
    hub = MemoryHub()
    publisher, subscriber = hub.connect("a"), hub.connect("b")
    subscriber.subscribe("x/+")
    for number in range(5):
        publisher.publish(f"x/{number % 2}", bytes([number]))
    assert [subscriber.receive(0) for _ in range(5)] == [Message(f"x/{n % 2}", bytes([n])) for n in range(5)]
    assert subscriber.receive(0.001) is None


def test_a_message_that_two_subscriptions_match_comes_once() -> None:
    hub = MemoryHub()
    subscriber = hub.connect("b")
    subscriber.subscribe("x/#", "x/1")
    hub.connect("a").publish("x/1", b"p")
    assert subscriber.receive(0) is not None
    assert subscriber.receive(0.001) is None


def test_a_publisher_hears_itself_if_it_subscribed() -> None:
    bus = MemoryHub().connect("a")
    bus.subscribe("x")
    bus.publish("x", b"p")
    assert bus.receive(0) == Message("x", b"p")


def test_the_newest_retained_message_greets_a_new_subscriber_marked_as_retained() -> None:
    hub = MemoryHub()
    publisher, early = hub.connect("a"), hub.connect("early")
    early.subscribe("x/1")
    publisher.publish("x/1", b"old", retain=True)
    publisher.publish("x/1", b"new", retain=True)
    publisher.publish("x/2", b"passing")
    late = hub.connect("late")
    late.subscribe("x/+")
    assert late.receive(0) == Message("x/1", b"new", retained=True)
    assert late.receive(0.001) is None
    assert early.receive(0) == Message("x/1", b"old", retained=False)


def test_an_empty_retained_message_clears_it() -> None:
    hub = MemoryHub()
    hub.connect("a").publish("x", b"old", retain=True)
    hub.connect("a2").publish("x", b"", retain=True)
    late = hub.connect("late")
    late.subscribe("x")
    assert late.receive(0.001) is None


def test_nothing_comes_after_unsubscribing_or_closing() -> None:
    hub = MemoryHub()
    publisher, first, second = hub.connect("a"), hub.connect("b"), hub.connect("c")
    for bus in (first, second):
        bus.subscribe("x")
    first.unsubscribe("x")
    second.close()
    publisher.publish("x", b"p")
    assert first.receive(0.001) is None
    assert second.receive(0.001) is None


def test_a_message_beyond_the_hubs_limit_is_an_error_and_counts_for_nothing() -> None:
    hub = MemoryHub(limit_bytes=2 + 32 + 2 + 10)  # the topic's length and its characters, packet identifier, payload
    bus = hub.connect("agent-1")
    bus.publish(WEIGHTS, bytes(10))
    bus.publish(WEIGHTS, bytes(12), qos=0)
    with pytest.raises(MessageTooLargeError, match=f"message of 47 bytes on {WEIGHTS}: the hub takes at most 46"):
        bus.publish(WEIGHTS, bytes(11))
    (row,) = bus.meter.rows()
    assert row.messages == 2


def test_receive_waits_for_a_message_from_another_thread() -> None:
    hub = MemoryHub()
    publisher, subscriber = hub.connect("a"), hub.connect("b")
    subscriber.subscribe("x")
    thread = threading.Thread(target=publisher.publish, args=("x", b"p"))
    got: list[Message | None] = []
    waiter = threading.Thread(target=lambda: got.append(subscriber.receive()))
    waiter.start()
    thread.start()
    waiter.join(10)
    thread.join(10)
    assert got == [Message("x", b"p")]


@pytest.mark.parametrize(
    ("published", "subscribed", "at_broker", "at_subscriber"),
    # 1 + 1 + 2 + 32 + 10 = 46 bytes, and 2 for a packet identifier; a delivery has the lower of both QoS
    [(0, 0, 46, 46), (0, 1, 46, 46), (1, 0, 48, 46), (1, 1, 48, 48)],
)
def test_both_sides_count_the_same_to_the_byte(
    published: int, subscribed: int, at_broker: int, at_subscriber: int
) -> None:
    hub = MemoryHub()
    publisher, subscriber = hub.connect("agent-1"), hub.connect("agent-2")
    subscriber.subscribe(WEIGHTS, qos=subscribed)
    publisher.publish(WEIGHTS, b"0123456789", qos=published)

    def totals(rows: list) -> list[tuple[str, str, int, int, int]]:
        return [(row.client, row.direction, row.messages, row.payload_bytes, row.packet_bytes) for row in rows]

    assert totals(hub.meter.rows()) == [("agent-1", "in", 1, 10, at_broker), ("agent-2", "out", 1, 10, at_subscriber)]
    assert totals(publisher.meter.rows()) == [("agent-1", "out", 1, 10, at_broker)]
    assert totals(subscriber.meter.rows()) == [("agent-2", "in", 1, 10, at_subscriber)]
