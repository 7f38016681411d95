"""Against a broker that is played by hand: what the client writes, when, and what it reads.

Packets as in MQTT 3.1.1, chapters 2 and 3.
"""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from queue import SimpleQueue

import pytest

import jouleswarm.common.bus.inbox
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.bus.suspects import CONNECTIONS
from jouleswarm.common.errors import ConfigurationError, MessageTooLargeError
from jouleswarm.common.wire import topics

CONNECT, PUBLISH, PUBACK, SUBSCRIBE, UNSUBSCRIBE, PINGREQ, DISCONNECT = 1, 3, 4, 8, 10, 12, 14
ACCEPTED = b"\x20\x02\x00\x00"
LIMIT_S = 20.0


@dataclass(frozen=True)
class Packet:
    """A packet as it came."""

    first: int
    body: bytes

    @property
    def kind(self) -> int:
        return self.first >> 4

    @property
    def published(self) -> tuple[str, bytes, bool]:
        """Topic, payload and DUP."""
        end = 2 + int.from_bytes(self.body[:2], "big")
        return self.body[2:end].decode(), self.body[end + (2 if self.first & 6 else 0) :], bool(self.first & 8)

    @property
    def packet_id(self) -> bytes:
        if self.kind != PUBLISH:
            return self.body[:2]
        end = 2 + int.from_bytes(self.body[:2], "big")
        return self.body[end : end + 2]


class Peer:
    """The broker's end of one connection."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock, self._file = sock, sock.makefile("rb")
        sock.settimeout(LIMIT_S)

    def read(self) -> Packet | None:
        """The next packet; None at the end."""
        if not (first := self._file.read(1)):
            return None
        length, place = 0, 0
        while True:
            digit = self._file.read(1)[0]
            length |= (digit & 127) << 7 * place
            place += 1
            if digit < 128:
                return Packet(first[0], self._file.read(length))

    def send(self, first: int, body: bytes = b"") -> None:
        length, digits = len(body), bytearray()
        while length >= 128:
            digits.append(length & 127 | 128)
            length >>= 7
        self._sock.sendall(bytes((first, *digits, length)) + body)

    def accept(self) -> str:
        """The client id."""
        packet = self.read()
        assert packet is not None
        assert packet.kind == CONNECT
        self._sock.sendall(ACCEPTED)
        return packet.body[12 : 12 + int.from_bytes(packet.body[10:12], "big")].decode()

    def answer(self, packet: Packet) -> None:
        """As a broker does that takes everything."""
        if packet.kind == PUBLISH and packet.first & 6:
            self.send(0x40, packet.packet_id)
        elif packet.kind == SUBSCRIBE:
            self.send(0x90, packet.packet_id + b"\1")
        elif packet.kind == UNSUBSCRIBE:
            self.send(0xB0, packet.packet_id)

    def serve(self) -> list[Packet]:
        """Answer everything until the client leaves; all that came."""
        packets = []
        while (packet := self.read()) is not None and packet.kind != DISCONNECT:
            packets.append(packet)
            self.answer(packet)
        self.close()
        return packets

    def close(self) -> None:
        self._file.close()
        self._sock.close()


Script = Callable[[Callable[[], Peer]], None]


@pytest.fixture
def played() -> Iterator[Callable[[Script], MqttBus]]:
    """Start a broker that follows a script, which takes connections one by one; a client of it."""
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(LIMIT_S)
    threads: list[threading.Thread] = []
    buses: list[MqttBus] = []
    errors: SimpleQueue[BaseException] = SimpleQueue()

    def play(script: Script) -> MqttBus:
        def run() -> None:
            try:
                script(lambda: Peer(listener.accept()[0]))
            except BaseException as error:  # noqa: BLE001 - raised again in the test's thread
                errors.put(error)

        threads.append(threading.Thread(target=run, daemon=True))
        threads[-1].start()
        url = f"mqtt://127.0.0.1:{listener.getsockname()[1]}"
        buses.append(MqttBus.connect(url, "agent-1", connect_timeout_s=LIMIT_S))
        return buses[-1]

    yield play
    for bus in buses:
        bus._stop()
    for thread in threads:
        thread.join(LIMIT_S)
    listener.close()
    if not errors.empty():
        raise errors.get()


def test_what_is_published_before_the_connack_waits_for_it_and_for_what_is_older(played):
    asked, published, over = threading.Event(), threading.Event(), threading.Event()
    seen: list[object] = []

    def script(accept: Callable[[], Peer]) -> None:
        first = accept()
        first.accept()
        for _ in range(2):
            first.read()
        first.close()
        second = accept()
        assert second.read().kind == CONNECT
        asked.set()
        assert published.wait(LIMIT_S)
        second._sock.settimeout(0.2)
        with pytest.raises(TimeoutError):  # not a byte more
            second._sock.recv(1)
        second._file, _ = second._sock.makefile("rb"), second._sock.settimeout(LIMIT_S)
        second._sock.sendall(ACCEPTED)
        seen.extend(packet.published for packet in second.serve() if packet.kind == PUBLISH)
        over.set()

    bus = played(script)
    for number in range(2):
        bus.publish("a", b"%d" % number)
    assert asked.wait(LIMIT_S)
    for number in range(2, 4):
        bus.publish("a", b"%d" % number)
    published.set()
    bus.flush()
    bus.close()
    assert over.wait(LIMIT_S)
    seen_in_order = [("a", b"0", True), ("a", b"1", True), ("a", b"2", False), ("a", b"3", False)]
    assert seen == seen_in_order


def test_a_retained_topic_goes_once_at_its_newest_value_and_what_was_taken_before_goes_first(played):
    taken, over, seen = threading.Event(), threading.Event(), []

    def script(accept: Callable[[], Peer]) -> None:
        first = accept()
        first.accept()
        first.answer(first.read())
        taken.set()
        for _ in range(5):
            first.read()
        first.close()
        second = accept()
        second.accept()
        seen.extend(packet.published[:2] for packet in second.serve() if packet.kind == PUBLISH)
        over.set()

    bus = played(script)
    bus.publish("known", b"k", retain=True)
    assert taken.wait(LIMIT_S)
    bus.flush()
    for stage in (b"1", b"2"):
        bus.publish("stage", stage, retain=True)
    bus.publish("plain", b"p")
    bus.publish("stage", b"3", retain=True)
    bus.publish("stage", b"", retain=True)
    bus.flush()
    bus.close()
    assert over.wait(LIMIT_S)
    # The last word before a retained topic is cleared is heard by those who listen; older ones are not needed.
    assert seen == [("known", b"k"), ("plain", b"p"), ("stage", b"3"), ("stage", b"")]


def test_both_sides_count_what_was_written(played):
    topic, over, got = topics.presence("run", 1, 1), threading.Event(), []

    def script(accept: Callable[[], Peer]) -> None:
        for number in range(2):
            peer = accept()
            peer.accept()
            if number == 0:
                got.extend(peer.read() for _ in range(3))
                peer.close()
            else:
                got.extend(packet for packet in peer.serve() if packet.kind == PUBLISH)
        over.set()

    bus = played(script)
    for stage in (b"1", b"22", b"333"):
        bus.publish(topic, stage, retain=True)
    bus.flush()
    bus.close()
    assert over.wait(LIMIT_S)
    (row,) = bus.meter.rows()
    payloads = [packet.published[1] for packet in got]
    assert payloads == [b"1", b"22", b"333", b"333"]
    assert (row.messages, row.payload_bytes) == (4, 9)
    assert row.packet_bytes == sum(2 + len(packet.body) for packet in got)  # each below 128 bytes


@pytest.mark.parametrize("qos", [0, 1])
def test_a_message_that_ends_every_connection_is_an_error_with_topic_and_size(played, qos):
    again = SimpleQueue()

    def script(accept: Callable[[], Peer]) -> None:
        for _ in range(CONNECTIONS):
            peer = accept()
            peer.accept()
            again.put(None)
            while (packet := peer.read()) is not None and packet.published[0] != "big":
                peer.answer(packet)
            peer.close()

    bus = played(script)

    def publish() -> None:
        for _ in range(CONNECTIONS if qos == 0 else 1):  # nobody else sends one at QoS 0 again
            again.get(timeout=LIMIT_S)
            bus._wait_for(lambda: bus._connected)
            bus.publish("small", b"s")
            bus.publish("big", bytes(5000), qos=qos)
            bus.flush()
        bus.receive(LIMIT_S)

    # 2 + 3 of the topic, 5000, at QoS 1 2 more; and 1 + 2 before that
    with pytest.raises(
        MessageTooLargeError, match=rf"message of {5008 + 2 * qos} bytes on big: .* {CONNECTIONS} times"
    ) as caught:
        publish()
    assert caught.value.exit_code == 5


def test_a_limit_that_the_broker_tells_is_compared_before_sending(played):
    def script(accept: Callable[[], Peer]) -> None:
        peer = accept()
        peer.accept()
        packet = peer.read()
        assert packet.kind == SUBSCRIBE
        assert topics.BROKER_LIMITS.encode() in packet.body
        peer.answer(packet)
        topic = topics.BROKER_LIMITS.encode()
        payload = json.dumps({"message_bytes": 100}).encode()
        peer.send(0x31, len(topic).to_bytes(2, "big") + topic + payload)
        peer.send(0x30, b"\0\1ax")
        assert [packet.published for packet in peer.serve() if packet.kind == PUBLISH] == [("a", bytes(95), False)]

    bus = played(script)
    bus.subscribe("a")
    assert bus.receive(LIMIT_S).topic == "a"  # the limits are no message of the user's
    with pytest.raises(MessageTooLargeError, match=r"message of 101 bytes on a: .* takes at most 100; "):
        bus.publish("a", bytes(96))  # 2 + 1 + 2 + 96
    bus.publish("a", bytes(95))
    bus.close()


def test_a_backlog_that_a_new_broker_does_not_take_is_an_error(played):
    def script(accept: Callable[[], Peer]) -> None:
        first = accept()
        first.accept()
        for _ in range(2):
            first.answer(first.read())
            first.answer = lambda packet: None
        first.close()
        second = accept()
        second.accept()
        second.answer(second.read())
        topic = topics.BROKER_LIMITS.encode()
        second.send(0x31, len(topic).to_bytes(2, "big") + topic + b'{"message_bytes": 100}')
        while second.read() is not None:
            pass

    bus = played(script)
    bus.subscribe("a")
    bus.publish("a", bytes(96))
    with pytest.raises(MessageTooLargeError, match="message of 101 bytes on a"):
        bus.flush()


@pytest.mark.parametrize("payload", [b"", b"{", b'{"message_bytes": 0}', b'{"message_bytes": "none"}', b"[" * 5000])
def test_limits_that_cannot_be_read_are_none(played, payload):
    def script(accept: Callable[[], Peer]) -> None:
        peer = accept()
        peer.accept()
        peer.answer(peer.read())
        topic = topics.BROKER_LIMITS.encode()
        peer.send(0x31, len(topic).to_bytes(2, "big") + topic + payload)
        peer.send(0x30, b"\0\1ax")
        peer.serve()

    bus = played(script)
    bus.subscribe("a")
    assert bus.receive(LIMIT_S).topic == "a"
    bus.publish("a", bytes(1000))
    bus.close()


def test_a_message_beyond_mqtt_itself_is_an_error_with_topic_and_size(played):
    bus = played(lambda accept: _answer_all(accept()))
    with pytest.raises(MessageTooLargeError, match=r"message of 268435456 bytes on a: .* at most 268435455"):
        bus.publish("a", bytes(268_435_455 - 4))


def test_unread_messages_are_not_acknowledged_beyond_the_budget_and_the_connection_lives_on(played, monkeypatch):
    # The tenth message of 10 000 bytes, a topic of 1 and 512 for the objects goes beyond it.
    monkeypatch.setattr(jouleswarm.common.bus.inbox, "BUDGET_BYTES", 10 * 10_513 - 100)
    monkeypatch.setattr(jouleswarm.common.bus.inbox, "GROWS_FOR_S", 1e6)
    acknowledged, pinged = [], threading.Event()

    def script(accept: Callable[[], Peer]) -> None:
        peer = accept()
        peer.accept()
        peer.answer(peer.read())
        for number in range(1, 21):
            peer.send(0x32, b"\0\1a" + number.to_bytes(2, "big") + bytes([number]) * 10_000)
        pings = 0
        while (packet := peer.read()) is not None and packet.kind != DISCONNECT:
            if packet.kind == PUBACK:
                acknowledged.append(int.from_bytes(packet.packet_id, "big"))
            elif packet.kind == PINGREQ:  # its answer stands behind what nobody reads
                peer.send(0xD0)
                pings += 1
                if pings == 3:
                    pinged.set()
            else:
                peer.answer(packet)
        peer.close()

    bus = played(script)
    bus._paho._keepalive = 1
    bus.subscribe("a")
    assert pinged.wait(LIMIT_S)
    assert acknowledged == list(range(1, 11))
    assert [bus.receive(LIMIT_S).payload[0] for _ in range(20)] == list(range(1, 21))
    assert bus.connections == 1
    bus.close()


def test_a_client_that_hears_without_a_pause_still_says_that_it_lives(played):
    pinged = threading.Event()

    def script(accept: Callable[[], Peer]) -> None:
        peer = accept()
        peer.accept()
        peer._sock.settimeout(0.01)
        while True:
            peer._sock.sendall(b"\x30\x04\0\1ax")
            with contextlib.suppress(TimeoutError):
                if peer._sock.recv(1) == b"\xc0":
                    break
        pinged.set()
        peer.close()

    bus = played(script)
    bus._paho._keepalive = 1
    assert pinged.wait(LIMIT_S)


def test_an_answer_that_stands_behind_what_nobody_reads_comes(played, monkeypatch):
    monkeypatch.setattr(jouleswarm.common.bus.inbox, "BUDGET_BYTES", 1)

    def script(accept: Callable[[], Peer]) -> None:
        peer = accept()
        peer.accept()
        peer.answer(peer.read())
        for number in range(1, 21):
            peer.send(0x32, b"\0\1a" + number.to_bytes(2, "big") + bytes([number]))
        peer.serve()

    bus = played(script)
    bus.subscribe("a")
    bus.publish("b", b"its PUBACK comes after 20 messages")
    bus.flush()
    bus.subscribe("c")
    assert [bus.receive(LIMIT_S).payload[0] for _ in range(20)] == list(range(1, 21))
    bus.close()


def test_a_broker_that_closes_the_connection_at_each_subscribe_refuses_it(played):
    def script(accept: Callable[[], Peer]) -> None:
        for _ in range(CONNECTIONS):
            peer = accept()
            peer.accept()
            peer.read()
            peer.close()

    bus = played(script)
    with pytest.raises(ConfigurationError, match=f"refused the subscription to a: .* {CONNECTIONS} times"):
        bus.subscribe("a")


def test_a_broker_that_minds_being_asked_for_its_limits_is_not_asked_again(played):
    asked = []

    def script(accept: Callable[[], Peer]) -> None:
        while True:
            peer = accept()
            peer.accept()
            packet = peer.read()
            asked.append(topics.BROKER_LIMITS.encode() in packet.body)
            if not asked[-1]:
                break
            peer.close()
        peer.answer(packet)
        peer.serve()

    bus = played(script)
    bus.subscribe("a")
    bus.close()
    assert asked == [True, True, False]


def test_who_gets_no_answer_to_its_subscriptions_twice_comes_back_by_another_id_of_its_name(played):
    ids = []

    def script(accept: Callable[[], Peer]) -> None:
        for answered in (False, False, True, True):
            peer = accept()
            ids.append(peer.accept())
            asked = peer.read()
            assert asked.kind == SUBSCRIBE
            if answered:
                peer.answer(asked)
            if len(ids) == 4:
                peer.serve()
            peer.close()

    bus = played(script)
    bus.subscribe("a")
    while len(ids) < 4:
        bus.receive(0.05)
    bus.close()
    assert {each.split(".")[0] for each in ids} == {"agent-1"}
    assert (ids[0] == ids[1], ids[1] != ids[2], ids[2] == ids[3]) == (True, True, True)


def test_packet_identifiers_of_messages_under_way_are_not_used_again(played):
    bus = played(lambda accept: _answer_all(accept()))
    with bus._paho._out_message_mutex:
        bus._paho._last_mid = 65_533
        bus._paho._out_messages[65_534] = bus._paho._out_messages[1] = None
        assert [bus._paho._mid_generate() for _ in range(2)] == [65_535, 2]
        bus._paho._out_messages.clear()


def _answer_all(peer: Peer) -> None:
    peer.accept()
    peer.serve()
