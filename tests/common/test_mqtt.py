"""The bus over MQTT: URLs, a broker that is away or goes away, and what it counts."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from jouleswarm.common.bus.address import BrokerAddress, parse_url
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.errors import BrokerUnreachableError, ConfigurationError, RemovedError

ROOT = Path(__file__).parents[2]
WEIGHTS = "jouleswarm/run/maml/sl/1/1/weights"  # 34 bytes


class Broker:
    """A broker process on a port that survives it."""

    def __init__(self) -> None:
        self.port, self.process = 0, None
        self.start()

    def start(self) -> None:
        command = [
            sys.executable,
            "-m",
            "jouleswarm.broker",
            "--port",
            str(self.port),
            "--no-metrics",
            "--exit-with-stdin",
        ]
        self.process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.url = json.loads(self.process.stdout.readline())["url"]
        self.port = int(self.url.rpartition(":")[2])

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(timeout=20)
        self.process.stdin.close()
        self.process.stdout.close()

    def stop(self) -> None:
        self.process.stdin.close()
        self.process.wait(timeout=20)
        self.process.stdout.close()


@pytest.fixture
def broker() -> Iterator[Broker]:
    broker = Broker()
    yield broker
    if broker.process.poll() is None:
        broker.stop()


@pytest.fixture
def connect(broker) -> Iterator[Callable[..., MqttBus]]:
    buses: list[MqttBus] = []

    def connect(client: str, **options: object) -> MqttBus:
        buses.append(MqttBus.connect(broker.url, client, **options))
        return buses[-1]

    yield connect
    for bus in buses:
        bus._stop()


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("mqtt://localhost", BrokerAddress("localhost", 1883)),
        ("mqtt://10.0.0.1:2883/", BrokerAddress("10.0.0.1", 2883)),
        ("mqtt://[::1]:1884", BrokerAddress("::1", 1884)),
        ("mqtt://robot:p%40ss@broker", BrokerAddress("broker", 1883, "robot", "p@ss")),
        ("mqtts://broker", BrokerAddress("broker", 8883, tls=True)),
        ("mqtts://robot:pass@[::1]:9000", BrokerAddress("::1", 9000, "robot", "pass", tls=True)),
    ],
)
def test_url(url, expected):
    assert parse_url(url) == expected


@pytest.mark.parametrize(
    "url",
    [
        *("", "localhost", "localhost:1883", "http://a", "mqtt://", "mqtt://:1883", "mqtt://a:port"),
        *("mqtt://a:70000", "mqtt://a:0", "mqtt://a/path", "mqtt://a?x=1", "mqtt://a b", "mqtt://[::1"),
    ],
)
def test_malformed_url_is_one_clear_line(url):
    with pytest.raises(ConfigurationError, match=r"expected mqtt://\[user:password@\]host\[:1883\]") as caught:
        MqttBus.connect(url, "agent-1")
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_password_is_never_shown():
    with pytest.raises(ConfigurationError) as caught:
        parse_url("mqtt://robot:secret@host:port")
    assert "secret" not in str(caught.value)
    assert str(parse_url("mqtt://robot:secret@host")) == "mqtt://host:1883"
    assert str(parse_url("mqtts://robot:secret@[::1]")) == "mqtts://[::1]:8883"


def test_unreachable_broker_is_tried_again_and_then_an_error_with_exit_code_3():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"mqtt://127.0.0.1:{listener.getsockname()[1]}"
        with pytest.raises(BrokerUnreachableError, match=r"no MQTT broker at mqtt://127\.0\.0\.1") as caught:
            MqttBus.connect(url, "agent-1", connect_timeout_s=0.5)
    assert caught.value.exit_code == 3
    with pytest.raises(BrokerUnreachableError, match="Connection refused"):
        MqttBus.connect(url, "agent-1", connect_timeout_s=0.5)


def test_broker_that_comes_late_is_found(broker):
    broker.stop()
    starting = threading.Timer(0.5, broker.start)
    starting.start()
    bus = MqttBus.connect(f"mqtt://127.0.0.1:{broker.port}", "agent-1", connect_timeout_s=30)
    starting.join()
    bus.close()


def test_round_trip_keeps_payload_and_counts_packets_exactly(connect):
    publisher, subscriber = connect("agent-1"), connect("agent-2")
    subscriber.subscribe("jouleswarm/run/+/sl/#")
    publisher.publish(WEIGHTS, b"abc", qos=0)
    publisher.publish(WEIGHTS, bytearray(b"abc" * 100), qos=1)
    publisher.publish(WEIGHTS, memoryview(b"abc" * 10_000)[6:], qos=1)
    publisher.flush()
    payloads = [bytes(subscriber.receive(20).payload) for _ in range(3)]
    assert payloads == [b"abc", b"abc" * 100, b"abc" * 9_998]
    # 1 + 1 + 2 + 34 + 3; 1 + 2 + 2 + 34 + 2 + 300; 1 + 3 + 2 + 34 + 2 + 29 994
    expected = (3, 3 + 300 + 29_994, 41 + 341 + 30_036)
    for bus, direction in ((publisher, "out"), (subscriber, "in")):
        (row,) = bus.meter.rows()
        assert (row.client, row.direction, row.side) == (bus.client, direction, "client")
        assert (row.messages, row.payload_bytes, row.packet_bytes) == expected


def test_receive_returns_none_after_its_timeout(connect):
    assert connect("agent-1").receive(0) is None
    assert connect("agent-2").receive(0.01) is None


def test_retained_messages_are_marked(connect):
    publisher, subscriber = connect("agent-1"), connect("agent-2")
    publisher.publish("state", b"kept", retain=True)
    publisher.flush()
    subscriber.subscribe("state")
    message = subscriber.receive(20)
    assert (bytes(message.payload), message.retained) == (b"kept", True)
    publisher.publish("state", b"new", retain=True)
    assert not subscriber.receive(20).retained


def test_nothing_comes_after_unsubscribe(connect):
    publisher, subscriber = connect("agent-1"), connect("agent-2")
    subscriber.subscribe("a", "b")
    subscriber.unsubscribe("a", "never subscribed")
    publisher.publish("a", b"x")
    publisher.publish("b", b"y")
    assert subscriber.receive(20).topic == "b"


def test_refused_subscription_is_an_error(connect):
    # paho itself lets this filter through as a text; the broker answers 0x80.
    bus = connect("agent-1")
    bus._paho._filter_wildcard_len_check = lambda _: 0
    with pytest.raises(ConfigurationError, match="refused the subscription to a#"):
        bus.subscribe("a#")


def test_reconnects_subscribes_again_and_sends_what_was_queued(broker, connect):
    publisher, subscriber = connect("agent-1"), connect("agent-2")
    subscriber.subscribe("a")
    broker.stop()
    broker.start()
    # A retained message reaches the subscriber whichever of the two is back first.
    publisher.publish("a", b"after the break", retain=True)
    publisher.flush()
    assert bytes(subscriber.receive(20).payload) == b"after the break"


def last_word(connect, topic: str) -> bytes:
    """What a broker tells who comes late."""
    late = connect("late")
    late.subscribe(topic)
    return bytes(late.receive(20).payload)


def test_what_was_retained_is_said_again_to_a_broker_that_was_started_anew(broker, connect):
    publisher, watcher = connect("agent-1"), connect("agent-2")
    for payload in (b"first", b"last"):
        publisher.publish("state", payload, retain=True)
    publisher.publish("state", b"passing")
    publisher.publish("gone", b"was here", retain=True)
    publisher.publish("gone", b"", retain=True)
    publisher.flush()
    broker.kill()
    broker.start()
    watcher.subscribe("state", "gone")  # comes before or after the publisher is back
    message = watcher.receive(20)
    assert (message.topic, bytes(message.payload)) == ("state", b"last")
    assert last_word(connect, "+") == b"last"
    assert (publisher.connections, watcher.connections) == (2, 2)


def test_the_retained_word_that_was_said_last_wins_also_while_the_broker_was_away(broker, connect):
    publisher = connect("agent-1")
    publisher.publish("state", b"before", retain=True)
    publisher.flush()
    broker.kill()
    for payload in (b"while it was away", b"last"):
        publisher.publish("state", payload, retain=True)
    broker.start()
    publisher.flush()
    assert last_word(connect, "state") == b"last"
    publisher.publish("state", b"after", retain=True)
    publisher.flush()
    assert last_word(connect, "state") == b"after"


def test_lost_broker_is_an_error_after_the_time_allowed(broker, connect):
    bus = connect("agent-1", connect_timeout_s=0.5)
    broker.stop()
    with pytest.raises(BrokerUnreachableError, match="no MQTT broker at"):
        bus.receive()
    bus.publish("a", b"never sent")
    for call in (bus.flush, lambda: bus.subscribe("a"), lambda: bus.receive(5)):
        with pytest.raises(BrokerUnreachableError):
            call()


def test_publish_waits_while_too_much_is_unsent():
    """Against a listener that accepts and then reads nothing of the messages."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        release = threading.Event()

        def accept() -> None:
            peer, _ = listener.accept()
            with peer:
                peer.recv(1000)  # CONNECT
                peer.sendall(b"\x20\x02\x00\x00")
                release.wait(30)

        server = threading.Thread(target=accept)
        server.start()
        bus = MqttBus.connect(f"mqtt://127.0.0.1:{listener.getsockname()[1]}", "agent-1", connect_timeout_s=2)
        sent = []

        def publish() -> None:
            with contextlib.suppress(BrokerUnreachableError):
                for _ in range(8):
                    bus.publish("a", bytes(16 * 1024 * 1024))
                    sent.append(1)

        publishing = threading.Thread(target=publish, daemon=True)
        publishing.start()
        deadline_s = time.monotonic() + 20
        while len(sent) < 4 and time.monotonic() < deadline_s:
            publishing.join(0.01)
        publishing.join(0.2)
        assert (len(sent), publishing.is_alive()) == (4, True)
        bus._on_failure(BrokerUnreachableError("ended by the test"))
        publishing.join(20)
        release.set()
        server.join()
        bus._stop()


def test_error_in_the_network_thread_reaches_the_user(connect):
    publisher, subscriber = connect("agent-1"), connect("agent-2")
    subscriber.subscribe("a")

    def fail(*_: object) -> None:
        raise ZeroDivisionError("in the network thread")

    subscriber._paho.on_received = fail
    publisher.publish("a", b"x")
    with pytest.raises(ZeroDivisionError, match="in the network thread"):
        subscriber.receive(20)


def test_message_that_is_sent_again_is_counted_again():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        seen = []

        def serve() -> None:
            for acknowledges in (False, True):
                peer, _ = listener.accept()
                with peer:
                    peer.recv(1000)  # CONNECT
                    peer.sendall(b"\x20\x02\x00\x00")
                    packet = b""
                    while len(packet) < 43:  # 1 + 1 + 2 + 34 + 2 + 3
                        packet += peer.recv(1000)
                    seen.append(packet)
                    if acknowledges:
                        peer.sendall(b"\x40\x02" + packet[38:40])
                        peer.recv(1000)  # DISCONNECT

        server = threading.Thread(target=serve)
        server.start()
        bus = MqttBus.connect(f"mqtt://127.0.0.1:{listener.getsockname()[1]}", "agent-1", connect_timeout_s=10)
        bus.publish(WEIGHTS, b"abc")
        bus.flush()
        bus.close()
        server.join()
    assert [packet[0] for packet in seen] == [0x32, 0x3A]  # the second time with DUP
    assert seen[0][1:] == seen[1][1:]
    (row,) = bus.meter.rows()
    assert (row.messages, row.payload_bytes, row.packet_bytes) == (2, 6, 86)


def test_message_with_a_topic_that_is_not_utf_8_is_ignored():
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            peer, _ = listener.accept()
            with peer:
                peer.recv(1000)
                peer.sendall(b"\x20\x02\x00\x00" + b"\x30\x05\x00\x02\xc3\x28x" + b"\x30\x04\x00\x01ay")
                peer.recv(1000)  # DISCONNECT

        server = threading.Thread(target=serve)
        server.start()
        bus = MqttBus.connect(f"mqtt://127.0.0.1:{listener.getsockname()[1]}", "agent-1", connect_timeout_s=5)
        message = bus.receive(20)
        assert (message.topic, bytes(message.payload)) == ("a", b"y")
        bus.close()
        server.join()


def test_close_counts_everything_that_was_delivered(connect):
    publisher, subscriber = connect("agent-1"), connect("agent-2")
    subscriber.subscribe("jouleswarm/run/#")
    for _ in range(20):
        publisher.publish(WEIGHTS, bytes(1_000_000))
    publisher.flush()
    subscriber.close()
    (row,) = subscriber.meter.rows()
    assert row.messages == 20


def test_a_broker_that_is_unavailable_for_now_is_tried_again_and_one_that_refuses_is_not():
    # CONNACK with return codes 3 (server unavailable), 0 (accepted) and 5 (not authorized): MQTT 3.1.1, table 3.1.
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"mqtt://127.0.0.1:{listener.getsockname()[1]}"
        connections = []

        def serve() -> None:
            for code in (3, 3, 0, 5):
                connection, _ = listener.accept()
                connections.append(connection)
                connection.recv(1000)
                connection.sendall(bytes((0x20, 2, 0, code)))

        server = threading.Thread(target=serve, daemon=True)
        server.start()
        bus = MqttBus.connect(url, "agent-1", connect_timeout_s=20)
        assert len(connections) == 3
        connections[2].close()  # it is gone, comes back, and knows the client no more
        with pytest.raises(RemovedError, match="not authorized"):
            bus.receive(20)
        server.join()
        bus._stop()
        for connection in connections:
            connection.close()


def test_a_broker_that_stays_unavailable_is_given_up_with_what_it_said():
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    connection, _ = listener.accept()
                    connection.recv(1000)
                    connection.sendall(b"\x20\x02\x00\x03")

        threading.Thread(target=serve, daemon=True).start()
        url = f"mqtt://127.0.0.1:{listener.getsockname()[1]}"
        with pytest.raises(BrokerUnreachableError, match="refused: server unavailable"):
            MqttBus.connect(url, "agent-1", connect_timeout_s=0.8)
