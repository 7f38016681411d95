"""Messages arrive whole, in order, once, at the right QoS; and are counted to the byte."""

from __future__ import annotations

import json
import random

import pytest

from common import topics
from common.snapshot import BrokerSnapshot

WEIGHTS = "jouleswarm/run/maml/sl/1/1/weights"  # 34 bytes


def ask(bus, token: str) -> BrokerSnapshot:
    """The broker's counters, later than everything this client has sent or received before."""
    bus.subscribe(topics.BROKER_METER)
    bus.publish(topics.BROKER_METER_ASK, token.encode())
    while True:
        message = bus.receive(20)
        assert message is not None, "the broker did not answer"
        if message.topic == topics.BROKER_METER:
            snapshot = BrokerSnapshot.model_validate_json(bytes(message.payload))
            if snapshot.asked == token:
                return snapshot


@pytest.mark.parametrize(("qos", "identifier_bytes"), [(0, 0), (1, 2)])
def test_broker_and_clients_count_the_same_bytes(broker, bus, qos, identifier_bytes):
    publisher, *subscribers = (bus(broker, f"agent-{number}") for number in (1, 2, 3))
    for subscriber in subscribers:
        subscriber.subscribe("jouleswarm/run/+/sl/#", qos=qos)
    sizes = (0, 1, 88, 89, 90, 91, 16_345, 16_346, 16_347, 16_348, 1_228_800, 5_565_072)
    for size in sizes:
        publisher.publish(WEIGHTS, random.Random(size).randbytes(size), qos=qos)
    for subscriber in subscribers:
        for size in sizes:
            message = subscriber.receive(20)
            assert bytes(message.payload) == random.Random(size).randbytes(size)
    publisher.flush()

    payload_bytes = sum(sizes)
    # Header of a packet: 1 + digits of the remaining length + 2 + 34 for the topic (+ 2 for the identifier).
    # Remaining length is 36 (38) + size: one digit up to 127, two up to 16 383, three up to 2 097 151.
    digits = {0: (1, 1, 1, 1, 1, 1, 2, 2, 2, 3, 3, 4), 1: (1, 1, 1, 1, 2, 2, 2, 3, 3, 3, 3, 4)}[qos]
    assert [36 + identifier_bytes + size for size in (91, 16_347)] == [
        127 + identifier_bytes,
        16_383 + identifier_bytes,
    ]
    packet_bytes = sum(1 + digit + 36 + identifier_bytes + size for digit, size in zip(digits, sizes, strict=True))
    expected = (len(sizes), payload_bytes, packet_bytes)

    rows = ask(publisher, "now").rows
    counted = {
        (row.client, row.topic, row.direction): (row.messages, row.payload_bytes, row.packet_bytes)
        for row in rows
        if row.direction != "acked"  # acknowledgements may still be on their way
    }
    assert counted == {
        ("agent-1", WEIGHTS, "in"): expected,
        ("agent-2", WEIGHTS, "out"): expected,
        ("agent-3", WEIGHTS, "out"): expected,
    }
    for client, direction in zip((publisher, *subscribers), ("out", "in", "in"), strict=True):
        (row,) = client.meter.rows()
        assert (row.client, row.direction) == (client.client, direction)
        assert (row.messages, row.payload_bytes, row.packet_bytes) == expected


@pytest.mark.parametrize(
    ("published", "subscribed", "expected"), [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 1), (2, 2, 1)]
)
def test_delivery_qos_is_the_lower_of_both_and_at_most_1(broker, raw, published, subscribed, expected):
    subscriber, publisher = raw(broker), raw(broker)
    subscriber.connect("s")
    publisher.connect("p")
    assert subscriber.subscribe("a/b", subscribed) == min(subscribed, 1)
    publisher.send(0x30 | published << 1, b"\x00\x03a/b" + (b"\x00\x07" if published else b"") + b"x")
    first, topic, _, payload = subscriber.read_publish()
    assert (first >> 1 & 3, topic, payload) == (expected, "a/b", b"x")


def test_qos_2_publication_is_taken_once_and_acknowledged_in_four_steps(broker, raw):
    subscriber, publisher = raw(broker), raw(broker)
    subscriber.connect("s")
    publisher.connect("p")
    subscriber.subscribe("a/b", 0)
    for first in (0x34, 0x3C):  # the second time as a duplicate, since no PUBREC had come
        publisher.send(first, b"\x00\x03a/b\x00\x07once")
        assert publisher.read() == (0x50, b"\x00\x07")
    publisher.send(0x62, b"\x00\x07")
    assert publisher.read() == (0x70, b"\x00\x07")
    assert subscriber.read_publish()[3] == b"once"
    subscriber.ping()  # nothing else came


def test_overlapping_filters_deliver_once_with_the_highest_qos(broker, raw):
    subscriber, publisher = raw(broker), raw(broker)
    subscriber.connect("s")
    publisher.connect("p")
    subscriber.subscribe("a/#", 0)
    subscriber.subscribe("a/+", 1)
    publisher.publish("a/b", b"x", 1)
    assert subscriber.read_publish()[0] == 0x32
    subscriber.ping()


def test_subscribing_again_changes_the_qos_and_unsubscribing_ends_deliveries(broker, raw):
    subscriber, publisher = raw(broker), raw(broker)
    subscriber.connect("s")
    publisher.connect("p")
    subscriber.subscribe("a", 1)
    publisher.publish("a", b"1", 1)
    assert subscriber.read_publish()[0] == 0x32
    subscriber.subscribe("a", 0)
    publisher.publish("a", b"2", 1)
    assert subscriber.read_publish()[0] == 0x30
    subscriber.send(0xA2, b"\x00\x02\x00\x01a")
    assert subscriber.read() == (0xB0, b"\x00\x02")
    publisher.publish("a", b"3", 1)
    subscriber.ping()


@pytest.mark.parametrize("bad", ["", "a#", "a/#/b", "+a/b", "a/b+"])
def test_malformed_filters_are_refused(broker, raw, bad):
    client = raw(broker)
    client.connect("c")
    assert client.subscribe(bad) == 0x80


def test_new_subscription_is_seen_by_a_topic_already_routed(broker, raw):
    first, second, publisher = raw(broker), raw(broker), raw(broker)
    for name, client in (("first", first), ("second", second), ("publisher", publisher)):
        client.connect(name)
    first.subscribe("a", 0)
    publisher.publish("a", b"1", 1)
    second.subscribe("+", 0)
    publisher.publish("a", b"2", 1)
    assert [first.read_publish()[3], first.read_publish()[3], second.read_publish()[3]] == [b"1", b"2", b"2"]


def test_messages_of_all_sizes_keep_their_order(broker, bus):
    publisher, subscriber = bus(broker, "p"), bus(broker, "s")
    subscriber.subscribe("order")
    choose = random.Random(5)
    payloads = [number.to_bytes(4, "big") + bytes(choose.choice((0, 10, 20_000, 700_000))) for number in range(200)]
    for payload in payloads:
        publisher.publish("order", payload, qos=1)
    assert [bytes(subscriber.receive(20).payload) for _ in payloads] == payloads


def test_snapshot_has_totals_each_second_and_rows_when_asked(broker, bus):
    client = bus(broker, "agent-7")
    client.subscribe("jouleswarm/run/#", topics.BROKER_METER)
    client.publish(WEIGHTS, b"12345")
    totals = None
    while not totals:
        message = client.receive(20)
        assert message is not None
        if message.topic == topics.BROKER_METER:
            snapshot = json.loads(bytes(message.payload))
            totals = snapshot["links"].get("sidelink")
    # 1 + 1 + 2 + 34 + 2 + 5
    assert totals["in"] == totals["out"] == {"messages": 1, "payload_bytes": 5, "packet_bytes": 45}
    assert snapshot["broker"] == "jouleswarm"
    assert "rows" not in snapshot
    assert "asked" not in snapshot
    answer = ask(client, "tøken")
    assert [(row.client, row.direction, row.link) for row in answer.rows] == [
        ("agent-7", "acked", "sidelink"),
        ("agent-7", "in", "sidelink"),
        ("agent-7", "out", "sidelink"),
    ]
    assert answer.sequence > snapshot["sequence"]


def test_prometheus_has_the_same_counts(broker, bus):
    client = bus(broker, "agent-7")
    client.subscribe("jouleswarm/run/#", qos=0)
    client.publish(WEIGHTS, b"12345", qos=0)
    assert client.receive(20) is not None
    samples = broker.scrape()
    labels = 'arm="maml",client="agent-7",direction="{}",link="sidelink",run="run"'
    for direction in ("in", "out"):
        where = "{" + labels.format(direction) + "}"
        assert samples[f"jouleswarm_broker_messages_total{where}"] == 1
        assert samples[f"jouleswarm_broker_payload_bytes_total{where}"] == 5
        assert samples[f"jouleswarm_broker_packet_bytes_total{where}"] == 43
    assert samples["jouleswarm_broker_clients"] == 1


def test_without_metering_nothing_is_counted(start_broker, bus):
    client = bus(start_broker("--no-meter"), "agent-7")
    client.subscribe("jouleswarm/run/#")
    client.publish(WEIGHTS, b"12345")
    assert client.receive(20) is not None
    answer = ask(client, "1")
    assert (answer.metering, answer.rows, answer.links) == (False, (), {})
