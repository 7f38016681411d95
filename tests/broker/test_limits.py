"""What a client may not do to the broker or to the others."""

from __future__ import annotations

import threading

import psutil
import pytest

MEGABYTE = 1024 * 1024


def memory_bytes(broker) -> int:
    return psutil.Process(broker.process.pid).memory_info().rss


def test_packet_over_the_size_limit_is_refused_from_its_header(start_broker, raw):
    broker = start_broker("--max-message-mb", "1")
    within, over = raw(broker), raw(broker)
    within.connect("w")
    within.send(0x30, b"\x00\x01a" + bytes(MEGABYTE - 3))
    within.ping()
    over.connect("o")
    over.sock.sendall(b"\x30\x81\x80\x40")  # 1 + 64 * 128^2 = 1 MiB + 1, and not a byte of it
    assert over.is_closed_by_broker()
    broker.counted("refused_too_large", 1)


def test_default_size_limit_is_64_mib(broker, raw):
    client = raw(broker)
    client.connect("c")
    before = memory_bytes(broker)
    client.sock.sendall(b"\x30\xff\xff\xff\x7f")  # 256 MiB - 1
    assert client.is_closed_by_broker()
    assert memory_bytes(broker) - before < 16 * MEGABYTE


def test_connection_that_never_connects_is_closed(start_broker, raw):
    broker = start_broker("--connect-timeout-s", "0.3")
    mute, slow, prompt = raw(broker), raw(broker), raw(broker)
    prompt.connect("p")
    slow.sock.sendall(b"\x10\x20\x00")
    assert mute.is_closed_by_broker()
    assert slow.is_closed_by_broker()
    broker.counted("refused_connect_timeout", 2)
    prompt.ping()


def test_connections_over_the_limit_are_closed(start_broker, raw, eventually):
    broker = start_broker("--max-connections", "2")
    first, second, third = raw(broker), raw(broker), raw(broker)
    first.connect("1")
    second.connect("2")
    assert third.is_closed_by_broker()
    broker.counted("refused_connections", 1)
    second.close()
    eventually(lambda: broker.scrape()["jouleswarm_broker_clients"] == 1, "the second has left")
    fourth = raw(broker)
    fourth.connect("4")


@pytest.mark.parametrize(
    "packet",
    [
        b"\x30\xff\xff\xff\xff\x01",  # remaining length of five bytes
        b"\x36\x05\x00\x01a\x00\x01",  # QoS 3
        b"\x30\x03\x00\x05a",  # topic longer than the packet
        b"\x30\x01\x00",  # no room for a topic length
        b"\x30\x04\x00\x02\xc3\x28",  # topic not UTF-8
        b"\x30\x02\x00\x00",  # empty topic
        b"\x30\x03\x00\x01#",  # wildcard in a topic
        b"\x82\x02\x00\x01",  # SUBSCRIBE to nothing
        b"\x82\x06\x00\x01\x00\x01a\x03",  # SUBSCRIBE with QoS 3
        b"\x82\x07\x00\x01\x00\x09abc",  # filter longer than the packet
        b"\x80\x06\x00\x01\x00\x01a\x01",  # SUBSCRIBE with wrong flags
        b"\xa2\x02\x00\x01",  # UNSUBSCRIBE from nothing
        b"\x40\x01\x00",  # short PUBACK
        b"\x00\x00",  # reserved packet types
        b"\xf0\x00",
        b"\x20\x02\x00\x00",  # what only a server sends
        b"\x10\x0d\x00\x04MQTT\x04\x02\x00\x00\x00\x01x",  # a second CONNECT
    ],
)
def test_malformed_packet_costs_its_sender_the_connection_and_nobody_else(broker, raw, packet):
    healthy, bad = raw(broker), raw(broker)
    healthy.connect("h")
    bad.connect("b")
    bad.sock.sendall(packet)
    assert bad.is_closed_by_broker()
    healthy.ping()
    broker.counted("refused_malformed", 1)
    assert broker.event("internal_errors") == 0


@pytest.mark.parametrize(
    "packet",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"\x30\x04\x00\x01ax",  # PUBLISH first
        b"\x10\x00",  # empty CONNECT
        b"\x10\x0d\x00\x04MQTT\x04\x04\x00\x00\x00\x01x",  # a will flag without a will
        b"\x10\x0d\x00\x04MQXX\x04\x02\x00\x00\x00\x01x",  # another protocol
        b"\x10\x0d\x00\x04MQTT\x04\x03\x00\x00\x00\x01x",  # the reserved flag
        b"\x10\x0d\x00\x04MQTT\x04\x02\x00\x00\x00\x30x",  # client id longer than the packet
    ],
)
def test_what_is_no_connect_is_closed(start_broker, raw, packet):
    broker = start_broker("--connect-timeout-s", "1")
    healthy, bad = raw(broker), raw(broker)
    healthy.connect("h")
    bad.sock.sendall(packet)
    assert bad.is_closed_by_broker()
    healthy.ping()
    assert broker.event("internal_errors") == 0


def test_mqtt_5_is_refused_with_its_return_code(broker, raw):
    client = raw(broker)
    client.send(0x10, b"\x00\x04MQTT\x05\x02\x00\x3c\x05\x11\x00\x00\x00\x0a\x00\x01x")
    assert client.read() == (0x20, b"\x00\x01")  # unacceptable protocol version (section 3.2.2.3)
    assert client.is_closed_by_broker()


def test_stuck_subscriber_neither_grows_memory_nor_stops_the_others_for_ever(start_broker, raw, eventually):
    broker = start_broker("--memory-mb", "32", "--stall-timeout-s", "2")
    before = memory_bytes(broker)
    stuck, healthy, publisher = raw(broker), raw(broker), raw(broker)
    stuck.connect("stuck")
    stuck.subscribe("a", 0)
    healthy.connect("healthy")
    healthy.subscribe("a", 0)
    publisher.connect("p")
    count, payload, peak = 30, bytes(5_570_000), 0
    sending = threading.Thread(target=lambda: [publisher.publish("a", payload, 1) for _ in range(count)])
    sending.start()
    for _ in range(count):
        assert len(healthy.read_publish()[3]) == len(payload)
        peak = max(peak, memory_bytes(broker))
    sending.join()
    broker.counted("dropped_stalled", 1)
    # 167 MB went through; the budget and a message or two are allowed.
    assert peak - before < 64 * MEGABYTE
    eventually(lambda: broker.scrape()["jouleswarm_broker_held_bytes"] == 0, "all messages are let go")


def test_slow_reader_is_never_dropped(start_broker, raw):
    broker = start_broker("--memory-mb", "8", "--stall-timeout-s", "1")
    slow, publisher = raw(broker), raw(broker)
    slow.connect("slow")
    slow.subscribe("a", 0)
    publisher.connect("p")
    pace = raw(broker)
    pace.connect("pace", keepalive_s=0)
    payload = bytes(4_000_000)
    sending = threading.Thread(target=lambda: [publisher.publish("a", payload, 1) for _ in range(8)])
    sending.start()
    left = 8 * (len(payload) + 1 + 4 + 3)
    slow.sock.settimeout(30)
    while left:
        left -= len(slow.sock.recv(min(left, 1_500_000)))
        # A pause of about a tenth of a second between reads, by the clock of nobody in particular.
        pace.is_closed_by_broker(within_s=0.1)
    sending.join()
    slow.ping()
    assert broker.event("dropped_stalled") == 0


def test_publisher_is_slowed_down_and_nothing_is_lost(start_broker, bus):
    broker = start_broker("--memory-mb", "4")
    publisher = bus(broker, "p")
    subscribers = [bus(broker, f"s-{number}") for number in range(3)]
    for subscriber in subscribers:
        subscriber.subscribe("a")
    for number in range(20):
        publisher.publish("a", bytes([number]) * 2_000_000)
    for subscriber in subscribers:
        for number in range(20):
            assert bytes(subscriber.receive(20).payload[:1]) == bytes([number])


def test_message_larger_than_the_whole_budget_still_passes(start_broker, bus):
    broker = start_broker("--memory-mb", "1")
    publisher, subscriber = bus(broker, "p"), bus(broker, "s")
    subscriber.subscribe("a")
    for _ in range(3):
        publisher.publish("a", bytes(5_000_000))
    assert [len(subscriber.receive(20).payload) for _ in range(3)] == [5_000_000] * 3


def test_client_that_stops_in_the_middle_of_a_packet_is_dropped(start_broker, raw):
    broker = start_broker("--stall-timeout-s", "0.5")
    client = raw(broker)
    client.connect("c")
    client.sock.sendall(b"\x30\x20\x00\x01a")
    assert client.is_closed_by_broker()
    broker.counted("dropped_stalled", 1)


def test_delivery_that_was_cut_off_is_not_counted_as_delivered(broker, raw, bus, eventually):
    topic = "jouleswarm/run/maml/sl/1/1/weights"
    mortal, publisher = raw(broker), bus(broker, "p")
    mortal.connect("mortal")
    mortal.subscribe(topic, 0)
    publisher.publish(topic, bytes(40_000_000))
    publisher.flush()
    mortal.close()
    eventually(lambda: broker.event("aborted_deliveries") == 1, "the delivery is booked as aborted")
    assert not [name for name in broker.scrape() if 'client="mortal"' in name]
    assert 0 < broker.event("aborted_bytes") < 40_000_000
