"""Numbered statements of MQTT 3.1.1 that one packet does not decide, on one broker: QoS 2, `$` topics, ends."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import pytest

from tests.broker.conftest import BrokerProcess, RawClient, broker_process, text

fresh = map(str, itertools.count(1))


@pytest.fixture(scope="module")
def standing() -> Iterator[BrokerProcess]:
    with broker_process() as started:
        yield started


@pytest.fixture
def dial(standing: BrokerProcess, raw: Callable[..., RawClient]) -> Callable[..., RawClient]:
    """Connects a client, by default with a new name and a clean session."""

    def connect(name: str = "", **options: object) -> RawClient:
        client = raw(standing)
        client.present = client.connect(name or f"c{next(fresh)}", **options)
        return client

    return connect


@pytest.fixture
def topic() -> str:
    return f"t/{next(fresh)}"


def publish_2(client: RawClient, topic: str, payload: bytes, packet_id: bytes = b"\0\7") -> None:
    """With its whole handshake."""
    client.send(0x34, text(topic) + packet_id + payload)
    assert client.read() == (0x50, packet_id)
    client.send(0x62, packet_id)
    assert client.read() == (0x70, packet_id)


def test_4_3_3_1_to_a_subscriber_in_four_steps_and_never_again(dial, topic):
    subscriber, publisher = dial(), dial()
    assert subscriber.subscribe(topic, 2) == 2
    publish_2(publisher, topic, b"x")
    first, _, packet_id, payload = subscriber.read_publish()
    assert (first, payload) == (0x34, b"x")
    for _ in range(2):  # a PUBREC that comes again is answered again
        subscriber.send(0x50, packet_id)
        assert subscriber.read() == (0x62, packet_id)
    subscriber.send(0x70, packet_id)
    subscriber.ping()


def test_4_3_3_2_from_a_publisher_exactly_once_until_its_pubrel(dial, topic):
    subscriber, publisher = dial(), dial()
    subscriber.subscribe(topic, 0)
    for first in (0x34, 0x3C, 0x34):
        publisher.send(first, text(topic) + b"\0\7once")
        assert publisher.read() == (0x50, b"\0\7")
    for _ in range(2):  # a PUBREL that comes again is answered again
        publisher.send(0x62, b"\0\7")
        assert publisher.read() == (0x70, b"\0\7")
    publish_2(publisher, topic, b"by the same identifier, but new")
    assert [subscriber.read_publish()[3] for _ in range(2)] == [b"once", b"by the same identifier, but new"]
    subscriber.ping()


def test_4_3_3_2_pubrec_comes_before_what_the_publisher_itself_gets(dial, topic):
    both = dial()
    both.subscribe(topic, 2)
    both.send(0x34, text(topic) + b"\0\7x")
    assert both.read() == (0x50, b"\0\7")
    assert both.read_publish()[3] == b"x"


def test_4_4_0_1_from_a_publisher_exactly_once_over_reconnects(dial, topic):
    subscriber, name = dial(), f"p{next(fresh)}"
    subscriber.subscribe(topic, 1)
    publisher = dial(name, clean=False)
    publisher.send(0x34, text(topic) + b"\0\7once")
    assert publisher.read() == (0x50, b"\0\7")
    publisher.close()
    again = dial(name, clean=False)
    again.send(0x3C, text(topic) + b"\0\7once")
    assert again.read() == (0x50, b"\0\7")
    again.close()
    last = dial(name, clean=False)
    last.send(0x62, b"\0\7")
    assert last.read() == (0x70, b"\0\7")
    assert subscriber.read_publish()[3] == b"once"
    subscriber.ping()


def test_4_4_0_1_to_a_subscriber_again_with_dup_then_only_pubrel(dial, topic):
    name = f"p{next(fresh)}"
    subscriber = dial(name, clean=False)
    subscriber.subscribe(topic, 2)
    publish_2(dial(), topic, b"x")
    first, _, packet_id, _ = subscriber.read_publish()
    assert first == 0x34
    subscriber.close()
    again = dial(name, clean=False)
    assert again.read_publish() == (0x3C, topic, packet_id, b"x")
    again.send(0x50, packet_id)
    assert again.read() == (0x62, packet_id)
    again.close()
    third = dial(name, clean=False)
    assert third.read() == (0x62, packet_id)
    third.send(0x70, packet_id)
    third.ping()
    third.close()
    dial(name, clean=False).ping()


def test_4_6_0_unacknowledged_first_then_what_was_kept_each_in_its_order_and_qos(dial, topic):
    name = f"p{next(fresh)}"
    subscriber, publisher = dial(name, clean=False), dial()
    subscriber.subscribe(topic, 2)
    publisher.publish(topic, b"0", 1)
    publish_2(publisher, topic, b"1")
    assert [subscriber.read_publish()[3] for _ in range(2)] == [b"0", b"1"]  # and acknowledges neither
    subscriber.send(0xE0)
    assert subscriber.is_closed_by_broker()
    publisher.publish(topic, b"not kept", 0)
    publish_2(publisher, topic, b"2")
    publisher.publish(topic, b"3", 1)
    again = dial(name, clean=False)
    assert again.present == 1
    assert [again.read_publish()[::3] for _ in range(4)] == [(0x3A, b"0"), (0x3C, b"1"), (0x34, b"2"), (0x32, b"3")]
    again.ping()


@pytest.mark.parametrize(
    ("qos", "answers"),
    [(1, (0x50,)), (1, (0x70,)), (2, (0x40,)), (2, (0x70,))],
    ids=["PUBREC at QoS 1", "PUBCOMP at QoS 1", "PUBACK at QoS 2", "PUBCOMP before PUBREC"],
)
def test_4_8_0_1_an_acknowledgement_of_another_kind_closes(dial, topic, qos, answers):
    subscriber = dial()
    subscriber.subscribe(topic, qos)
    publish_2(dial(), topic, b"x")
    packet_id = subscriber.read_publish()[2]
    for first in answers:
        subscriber.send(first, packet_id)
    assert subscriber.is_closed_by_broker()


def test_acknowledgements_of_what_is_not_known_are_answered_where_they_have_an_answer(dial):
    client = dial()
    for first in (0x40, 0x70):
        client.send(first, b"\0\5")
    client.ping()
    client.send(0x50, b"\0\5")
    assert client.read() == (0x62, b"\0\5")
    client.send(0x62, b"\0\5")
    assert client.read() == (0x70, b"\0\5")


@pytest.mark.parametrize("retained", [0, 1, 2])
@pytest.mark.parametrize("granted", [0, 1, 2])
def test_3_8_4_6_retained_at_the_lower_qos(dial, topic, retained, granted):
    publisher, late = dial(), dial()
    if retained == 2:
        publisher.send(0x35, text(topic) + b"\0\7kept")
        assert publisher.read() == (0x50, b"\0\7")
    else:
        publisher.publish(topic, b"kept", retained, retain=True)
        publisher.ping()
    late.subscribe(topic, granted)
    first, _, _, payload = late.read_publish()
    assert (first, payload) == (0x31 | min(retained, granted) << 1, b"kept")


def test_3_1_2_17_a_will_is_published_and_retained_at_its_qos(dial, topic):
    watcher, mortal = dial(), dial(will=(topic, b"gone"), will_flags=0x30)  # retained, QoS 2
    watcher.subscribe(topic, 2)
    mortal.send(0xF0)
    assert watcher.read_publish()[::3] == (0x34, b"gone")
    late = dial()
    late.subscribe(topic, 2)
    assert late.read_publish()[::3] == (0x35, b"gone")


@pytest.mark.parametrize("end", [b"\xe1\x00", b"\xe0\x01\x00", b"\xc0\x01\x00", b"\x10\x00", b"\x51\x02\x00\x01"])
def test_3_1_2_8_the_will_of_a_client_that_breaks_the_protocol(dial, topic, end):
    watcher, mortal = dial(), dial(will=(topic, b"gone"))
    watcher.subscribe(topic, 0)
    mortal.sock.sendall(end)
    assert watcher.read_publish()[3] == b"gone"
    assert mortal.is_closed_by_broker()


@pytest.mark.parametrize("first", [0x30, 0x31, 0x32, 0x33, 0x34, 0x35])
def test_4_7_2_what_clients_publish_below_a_dollar_is_acknowledged_and_dropped(dial, standing, first):
    watcher, publisher, before = dial(), dial(), standing.event("refused_reserved")
    watcher.subscribe("$mine/#", 2)
    publisher.send(first, text("$mine/a") + (b"\0\7" if first > 0x31 else b"") + b"x")
    if first > 0x31:
        assert publisher.read() == (0x40 if first < 0x34 else 0x50, b"\0\7")
    publisher.ping()
    watcher.ping()
    late = dial()
    late.subscribe("$mine/a", 2)
    late.ping()
    standing.counted("refused_reserved", before + 1)


def test_4_7_2_a_will_below_a_dollar_is_taken_and_dropped(dial, standing, eventually):
    watcher, mortal, before = dial(), dial(will=("$mine/a", b"gone")), standing.event("refused_reserved")
    watcher.subscribe("$mine/#", 0)
    mortal.close()
    eventually(lambda: standing.event("refused_reserved") == before + 1, "the will is dropped")
    watcher.ping()


@pytest.mark.parametrize("topic_filter", ["#", "+/#", "+/jouleswarm/limits", "+/+/+"])
def test_4_7_2_1_wildcards_at_the_beginning_match_nothing_of_the_brokers(dial, topic_filter):
    client = dial()
    client.subscribe(topic_filter, 0)
    client.send(0x82, b"\0\2" + text("$SYS/jouleswarm/limits") + b"\0")  # comes after what the first one brings
    while (packet := client.read()) != (0x90, b"\0\2\0"):
        assert not packet[1].startswith(text("$SYS/jouleswarm/limits"))
    assert client.read_publish()[1] == "$SYS/jouleswarm/limits"


@pytest.mark.parametrize("topic_filter", ["$share/group/a", "$share/group/#", "$share/x", "$share//a"])
def test_shared_subscriptions_of_mqtt_5_are_refused(dial, topic_filter):
    client = dial()
    assert client.subscribe(topic_filter) == 0x80
    client.ping()


def test_3_8_4_5_and_3_9_3_1_a_return_code_for_each_filter_in_their_order(dial):
    client = dial()
    filters = text("a") + b"\2" + text("$share/g/b") + b"\1" + text("c/+") + b"\0" + text("#") + b"\1"
    client.send(0x82, b"\1\2" + filters)
    assert client.read() == (0x90, b"\1\2\x02\x80\x00\x01")


def test_3_10_4_5_unsubscribing_from_what_was_not_subscribed_to_is_confirmed(dial):
    client = dial()
    client.send(0xA2, b"\1\2" + text("never/was") + text("a/+"))
    assert client.read() == (0xB0, b"\1\2")


@pytest.mark.parametrize(
    ("connect", "connack"),
    [
        (text("MQTT") + b"\x06\x02\0\0" + text("a"), b"\0\1"),
        (text("MQTT") + b"\x04\x00\0\0" + text(""), b"\0\2"),
        (text("MQIsdp") + b"\x03\x02\0\0" + text(""), b"\0\2"),
    ],
)
def test_3_1_2_2_and_3_1_3_8_what_is_not_accepted_is_told_by_its_code_and_closed(standing, raw, connect, connack):
    client = raw(standing)
    client.send(0x10, connect)
    assert client.read() == (0x20, connack)
    assert client.is_closed_by_broker()


def test_3_1_3_6_without_a_client_id_each_gets_its_own(standing, raw):
    clients = [raw(standing) for _ in range(2)]
    for client in clients:
        client.connect("")
    for client in clients:
        client.ping()


def test_3_1_3_5_a_password_is_any_bytes(standing, raw):
    client = raw(standing)
    client.send(0x10, text("MQTT") + b"\x04\xc2\0\0" + text(f"c{next(fresh)}") + text("user") + b"\0\3\xff\0\xfe")
    assert client.read() == (0x20, b"\0\0")


def test_3_2_2_session_present_only_where_one_is_kept(dial):
    name = f"p{next(fresh)}"
    present = []
    for clean in (False, False, True, False):
        client = dial(name, clean=clean)
        present.append(client.present)
        client.send(0xE0)
        assert client.is_closed_by_broker()
    assert present == [0, 1, 0, 0]


def test_mqtt_3_1_clients_are_served(standing, raw, topic):
    client = raw(standing)
    client.send(0x10, text("MQIsdp") + b"\x03\x00\0\0" + text(f"c{next(fresh)}"))
    assert client.read() == (0x20, b"\0\0")
    client.subscribe(topic, 0)
    client.send(0x34, text(topic) + b"\0\7x")
    assert client.read() == (0x50, b"\0\7")
    assert client.read_publish()[3] == b"x"
    client.send(0x6A, b"\0\7")  # PUBREL with DUP, which 3.1 has and 3.1.1 has not
    assert client.read() == (0x70, b"\0\7")
