"""Messages arrive whole, in order, once, at the right QoS; and are counted to the byte."""

from __future__ import annotations

import json
import random

import pytest

from jouleswarm.common.wire import topics
from jouleswarm.common.wire.broker_counters import PIECE_BYTES, BrokerLimits, CountersPiece, CountersRequest
from jouleswarm.common.wire.messages import encode_json
from tests.broker.conftest import text

WEIGHTS = "jouleswarm/run/maml/sl/1/1/weights"  # 34 bytes


def ask(bus, run: str = "run", token: str = "now") -> list[CountersPiece]:
    """The broker's counters of a run, later than everything this client has sent or received before."""
    answer = topics.broker_answer(token)
    bus.subscribe(answer)
    bus.publish(topics.BROKER_METER_ASK, encode_json(CountersRequest(asked=token, run=run)))
    pieces: list[CountersPiece] = []
    while not pieces or pieces[-1].piece < pieces[-1].pieces:
        message = bus.receive(20)
        assert message is not None, "the broker did not answer"
        if message.topic == answer:
            pieces.append(CountersPiece.model_validate_json(bytes(message.payload)))
    assert [piece.piece for piece in pieces] == [number + 1 for number in range(pieces[0].pieces)]
    assert {(piece.asked, piece.run) for piece in pieces} == {(token, run)}
    return pieces


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

    (piece,) = ask(publisher)
    counted = {
        (row.client, row.topic, row.direction): (row.messages, row.payload_bytes, row.packet_bytes)
        for row in piece.rows
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


@pytest.mark.parametrize("published", [0, 1, 2])
@pytest.mark.parametrize("subscribed", [0, 1, 2])
def test_delivery_qos_is_the_lower_of_both(broker, raw, published, subscribed):
    subscriber, publisher = raw(broker), raw(broker)
    subscriber.connect("s")
    publisher.connect("p")
    assert subscriber.subscribe("a/b", subscribed) == subscribed
    publisher.send(0x30 | published << 1, b"\x00\x03a/b" + (b"\x00\x07" if published else b"") + b"x")
    first, topic, _, payload = subscriber.read_publish()
    assert (first >> 1 & 3, topic, payload) == (min(published, subscribed), "a/b", b"x")


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


@pytest.mark.parametrize("bad", ["a#", "a/#/b", "+a/b", "a/b+"])
def test_malformed_filters_are_refused(broker, raw, bad):
    client = raw(broker)
    client.connect("c")
    assert client.subscribe(bad) == 0x80
    client.send(0xA2, b"\x00\x02" + text(bad))
    assert client.read() == (0xB0, b"\x00\x02")


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


def test_totals_come_each_second_below_sys(broker, bus):
    client = bus(broker, "agent-7")
    client.subscribe("jouleswarm/run/#", topics.BROKER_METER)
    client.publish(WEIGHTS, b"12345")
    totals = None
    while not totals:
        message = client.receive(20)
        assert message is not None
        if message.topic == "$SYS/jouleswarm/meter":
            snapshot = json.loads(bytes(message.payload))
            totals = snapshot["links"].get("sidelink")
    # 1 + 1 + 2 + 34 + 2 + 5
    assert totals["in"] == totals["out"] == {"messages": 1, "payload_bytes": 5, "packet_bytes": 45}
    assert snapshot["broker"] == "jouleswarm"
    assert "rows" not in snapshot


def test_who_asks_gets_the_rows_of_one_run_and_nothing_of_it_is_retained(broker, bus):
    client = bus(broker, "agent-7")
    client.subscribe("jouleswarm/run/#")
    for topic in (WEIGHTS, topics.weights("run2", "maml", 1, 1), topics.weights("ru", "maml", 1, 1)):
        client.publish(topic, b"12345")
    assert client.receive(20) is not None
    client.flush()
    (piece,) = ask(client)
    assert piece.metering
    assert [(row.client, row.direction, row.topic) for row in piece.rows if row.direction != "acked"] == [
        ("agent-7", "in", WEIGHTS),
        ("agent-7", "out", WEIGHTS),
    ]
    (other,) = ask(client, "run2", "other")
    assert [(row.direction, row.topic) for row in other.rows] == [("in", "jouleswarm/run2/maml/sl/1/1/weights")]
    late = bus(broker, "agent-8")
    (unknown,) = ask(late, "nothing-of-this-name", "now")  # by the first one's token: nothing of its answer was kept
    assert unknown.rows == ()


def test_a_delivery_at_qos_2_is_counted_once_and_acknowledged_by_its_pubrec(broker, raw, bus):
    subscriber, publisher, asking = raw(broker), raw(broker), bus(broker, "recorder")
    subscriber.connect("agent-2")
    publisher.connect("agent-1")
    subscriber.subscribe(WEIGHTS, 2)
    publisher.send(0x34, text(WEIGHTS) + b"\0\x0712345")
    assert publisher.read() == (0x50, b"\0\7")
    packet_id = subscriber.read_publish()[2]

    def counted(token: str) -> dict[tuple[str, str], tuple[int, int, int]]:
        (piece,) = ask(asking, token=token)
        rows = piece.rows
        return {(row.client, row.direction): (row.messages, row.payload_bytes, row.packet_bytes) for row in rows}

    whole = (1, 5, 45)  # 1 + 1 + 2 + 34 + 2 + 5 bytes
    assert counted("before") == {("agent-1", "in"): whole, ("agent-2", "out"): whole}
    for first, answer in ((0x50, 0x62), (0x50, 0x62)):
        subscriber.send(first, packet_id)
        assert subscriber.read() == (answer, packet_id)
    subscriber.send(0x70, packet_id)
    subscriber.ping()
    acknowledged = {("agent-1", "in"): whole, ("agent-2", "out"): whole, ("agent-2", "acked"): whole}
    assert counted("after") == acknowledged


def test_a_message_that_is_too_large_is_told_with_client_topic_and_size(start_broker, raw, bus):
    broker = start_broker("--max-message-mb", "1")
    for name in ("agent-1.1f00aa22", "agent-1.33445566"):  # twice the same client, as it connects anew
        client = raw(broker)
        client.connect(name)
        client.sock.sendall(b"\x32\x81\x80\x40" + text(WEIGHTS))  # 1 + 64 * 128^2 bytes
        assert client.is_closed_by_broker()
    (piece,) = ask(bus(broker, "recorder"))
    assert piece.refusals == (
        f"client agent-1: PUBLISH on '{WEIGHTS}' of 1048577 bytes, the limit here is 1048576 (2 times)",
    )


def test_an_answer_that_is_long_comes_in_pieces(broker, bus):
    client = bus(broker, "agent-7")
    sent = [topics.weights("run", "x" * 800, 1, number) for number in range(700)]
    for topic in sent:
        client.publish(topic, b"", qos=0)
    pieces = ask(client)
    assert len(pieces) > 1
    assert [row.topic for piece in pieces for row in piece.rows] == sorted(sent)
    assert max(len(encode_json(piece)) for piece in pieces) <= PIECE_BYTES


@pytest.mark.parametrize("question", [b"", b"token", b'{"asked":"a/b","run":"r"}', b'{"asked":"+","run":"r"}', b"{}"])
def test_a_question_that_is_none_is_counted_and_not_answered(broker, bus, question):
    client = bus(broker, "recorder")
    client.subscribe("$SYS/jouleswarm/meter/#")
    client.publish(topics.BROKER_METER_ASK, question)
    client.flush()
    broker.counted("refused_questions", 1)
    (piece,) = ask(client)
    assert piece.refusals == ("a question on jouleswarm/meter/ask that is none",)


@pytest.mark.parametrize("options", [(), ("--no-meter",)])
def test_the_broker_tells_the_largest_message_that_it_takes(start_broker, bus, options):
    client = bus(start_broker("--max-message-mb", "3", *options), "agent-7")
    client.subscribe(topics.BROKER_LIMITS)
    message = client.receive(20)
    assert (message.topic, message.retained) == ("$SYS/jouleswarm/limits", True)
    assert BrokerLimits.model_validate_json(bytes(message.payload)).message_bytes == 3 * 1024 * 1024


def test_prometheus_has_the_same_counts(broker, bus, eventually):
    client = bus(broker, "agent-7")
    client.subscribe("jouleswarm/run/#", qos=0)
    client.publish(WEIGHTS, b"12345", qos=0)
    assert client.receive(20) is not None
    labels = 'arm="maml",client="agent-7",direction="{}",link="sidelink",run="run"'
    # What is written is counted a moment later.
    delivered = f"jouleswarm_broker_messages_total{{{labels.format('out')}}}"
    eventually(lambda: delivered in broker.scrape(), "the delivery counted")
    samples = broker.scrape()
    for direction in ("in", "out"):
        where = "{" + labels.format(direction) + "}"
        assert samples[f"jouleswarm_broker_messages_total{where}"] == 1
        assert samples[f"jouleswarm_broker_payload_bytes_total{where}"] == 5
        assert samples[f"jouleswarm_broker_packet_bytes_total{where}"] == 43
    assert samples["jouleswarm_broker_clients"] == 1


def test_without_metering_nothing_is_counted_and_no_totals_are_published(start_broker, bus):
    client = bus(start_broker("--no-meter"), "agent-7")
    client.subscribe("jouleswarm/run/#", topics.BROKER_METER)
    client.publish(WEIGHTS, b"12345")
    assert client.receive(20).topic == WEIGHTS
    (piece,) = ask(client)
    assert (piece.metering, piece.rows) == (False, ())
