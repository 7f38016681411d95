"""Strict reading of the packets that clients send (MQTT 3.1.1, sections 1.5 and 3)."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import NamedTuple

from amqtt.mqtt.packet import CONNECT

from jouleswarm.broker.errors import MalformedPacket, NotAccepted
from jouleswarm.common.wire.mqtt import read_publish

PROTOCOLS = {"MQTT": 4, "MQIsdp": 3}  # name -> level: MQTT 3.1.1, and 3.1, whose packets are the same
SEPARATORS = 200  # of levels in a topic, as in Mosquitto
# Topics that need not be looked at anew, and how long each may be: what clients make up must not fill the memory.
KNOWN_TOPICS, KNOWN_BYTES = 4096, 256
# Characters for which section 1.5.3 lets a receiver close the connection; the first of them it must not take.
_FORBIDDEN = re.compile("[\0-\x1f\x7f-\x9f\ufdd0-\ufdef\ufffe\uffff]")
UNACCEPTABLE_LEVEL, IDENTIFIER_REJECTED = 1, 2  # return codes of CONNACK (section 3.2.2.3)

Subscription = tuple[str, int]
"""A topic filter and the QoS that is asked for."""


class Packet(NamedTuple):
    """A packet as received: first byte, everything after the fixed header, and what it took of the budget."""

    first: int
    body: memoryview
    cost_bytes: int


class Will(NamedTuple):
    """What the broker publishes for a client that goes without DISCONNECT."""

    topic: str
    payload: bytes
    qos: int
    retain: bool


class Connect(NamedTuple):
    """A CONNECT packet, taken apart. The client id is empty where the broker is to choose one."""

    level: int
    client_id: str
    clean_session: bool
    keepalive_s: int
    will: Will | None
    username: str | None
    password: bytes | None


class Publish(NamedTuple):
    """A PUBLISH packet, taken apart. `packet_id` is its two bytes, or empty at QoS 0."""

    topic: str
    packet_id: bytes
    payload: memoryview
    qos: int
    retain: bool


class _Fields:
    """The fields of a control packet, one after the other."""

    def __init__(self, kind: str, body: memoryview) -> None:
        self._kind, self._body, self._at = kind, bytes(body), 0

    @property
    def left_bytes(self) -> int:
        """What has not been taken yet."""
        return len(self._body) - self._at

    def take(self, count: int) -> bytes:
        """The next bytes."""
        if self.left_bytes < count:
            raise MalformedPacket(f"{self._kind} of {len(self._body)} bytes that ends within a field")
        self._at += count
        return self._body[self._at - count : self._at]

    def number(self, count: int) -> int:
        """A number of one or two bytes."""
        return int.from_bytes(self.take(count), "big")

    def data(self) -> bytes:
        """Bytes after their length."""
        return self.take(self.number(2))

    def text(self) -> str:
        """A string (section 1.5.3)."""
        return decode_text(self.data(), self._kind)

    def packet_id(self) -> bytes:
        """An identifier, which is never 0 (section 2.3.1)."""
        identifier = self.take(2)
        if not any(identifier):
            raise MalformedPacket(f"{self._kind} with packet identifier 0")
        return identifier


def decode_text(data: bytes, where: str) -> str:
    """Well-formed UTF-8 without control characters (section 1.5.3)."""
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise MalformedPacket(f"{where} with a string that is not UTF-8") from error
    if not text.isprintable() and (found := _FORBIDDEN.search(text)):
        raise MalformedPacket(f"{where} with U+{ord(found[0]):04X} in a string")
    return text


def parse_connect(first: int, body: memoryview) -> Connect:
    """Take a CONNECT packet apart (section 3.1)."""
    if first != CONNECT << 4:
        raise MalformedPacket(f"the first packet is 0x{first:02x}, expected CONNECT")
    fields = _Fields("CONNECT", body)
    if (name := fields.text()) not in PROTOCOLS:
        raise MalformedPacket(f"CONNECT for the protocol {name!r}, expected MQTT")
    if (level := fields.number(1)) != PROTOCOLS[name]:
        raise NotAccepted(UNACCEPTABLE_LEVEL, f"CONNECT for {name} of level {level}, expected {PROTOCOLS[name]}")
    flags, keepalive_s = fields.number(1), fields.number(2)
    has_will, has_user, has_password = flags & 4, flags & 128, flags & 64
    if flags & 1 or (flags & 56 and not has_will) or flags & 24 == 24 or (has_password and not has_user):
        raise MalformedPacket(f"CONNECT with the flags 0x{flags:02x}, which do not go together")
    client_id, clean_session = fields.text(), bool(flags & 2)
    will = Will(fields.text(), fields.data(), flags >> 3 & 3, bool(flags & 32)) if has_will else None
    username = fields.text() if has_user else None
    password = fields.data() if has_password else None
    if fields.left_bytes:
        raise MalformedPacket(f"CONNECT with {fields.left_bytes} bytes left over")
    if will is not None and not is_topic(will.topic):
        raise MalformedPacket(f"last will on topic {will.topic!r}, which cannot be published on")
    if not client_id and (not clean_session or level < 4):
        raise NotAccepted(IDENTIFIER_REJECTED, "CONNECT without a client id, for a session that is to be kept")
    return Connect(level, client_id, clean_session, keepalive_s, will, username, password)


def parse_publish(first: int, body: memoryview) -> Publish:
    """Take a PUBLISH packet apart (MQTT 3.1.1, section 3.3); the payload is not copied."""
    qos = first >> 1 & 3
    try:
        name, packet_id, payload = read_publish(first, body)
    except ValueError as error:
        raise MalformedPacket(str(error)) from error
    if qos and not any(packet_id):
        raise MalformedPacket("PUBLISH with packet identifier 0")
    if not qos and first & 8:
        raise MalformedPacket("PUBLISH with QoS 0 and DUP")
    topic = _known_topic(name) if len(name) <= KNOWN_BYTES else _topic(name)
    return Publish(topic, packet_id, payload, qos, bool(first & 1))


def _topic(name: bytes) -> str:
    topic = decode_text(name, "PUBLISH")
    if not is_topic(topic):
        raise MalformedPacket(f"PUBLISH on topic {topic!r}, which cannot be published on")
    return topic


_known_topic = lru_cache(KNOWN_TOPICS)(_topic)


def parse_subscribe(body: memoryview) -> tuple[bytes, list[Subscription]]:
    """Packet identifier and subscriptions of a SUBSCRIBE packet (section 3.8)."""
    fields, subscriptions = _Fields("SUBSCRIBE", body), list[Subscription]()
    packet_id = fields.packet_id()
    while fields.left_bytes or not subscriptions:
        topic_filter, qos = _filter(fields, "SUBSCRIBE"), fields.number(1)
        if qos > 2:
            raise MalformedPacket(f"SUBSCRIBE with 0x{qos:02x} for a QoS, expected 0, 1 or 2")
        subscriptions.append((topic_filter, qos))
    return packet_id, subscriptions


def parse_unsubscribe(body: memoryview) -> tuple[bytes, list[str]]:
    """Packet identifier and topic filters of an UNSUBSCRIBE packet (section 3.10)."""
    fields, filters = _Fields("UNSUBSCRIBE", body), list[str]()
    packet_id = fields.packet_id()
    while fields.left_bytes or not filters:
        filters.append(_filter(fields, "UNSUBSCRIBE"))
    return packet_id, filters


def parse_packet_id(body: memoryview) -> int:
    """The packet identifier that is all of an acknowledgement."""
    if len(body) != 2 or not any(body):
        raise MalformedPacket(f"acknowledgement of {bytes(body[:8]).hex(' ') or 'nothing'}, expected an identifier")
    return int.from_bytes(body, "big")


def is_topic(topic: str) -> bool:
    """Whether messages can be published on this topic (section 4.7)."""
    return bool(topic) and "+" not in topic and "#" not in topic and topic.count("/") <= SEPARATORS


def is_filter(topic_filter: str) -> bool:
    """Whether this can be subscribed to: wildcards fill their levels, and # is the last one (section 4.7.1)."""
    *above, last = topic_filter.split("/")
    return bool(topic_filter) and _is_level(last, "+#") and all(_is_level(level, "+") for level in above)


def _is_level(level: str, wildcards: str) -> bool:
    return (len(level) == 1 and level in wildcards) or ("+" not in level and "#" not in level)


def _filter(fields: _Fields, kind: str) -> str:
    topic_filter = fields.text()
    if not topic_filter or topic_filter.count("/") > SEPARATORS:
        what = f"one of over {SEPARATORS} levels" if topic_filter else "an empty one"
        raise MalformedPacket(f"{kind} with {what} for a topic filter")
    return topic_filter
