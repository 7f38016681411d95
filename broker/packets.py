"""Strict reading of the packets that clients send: amqtt's codecs make do with what there is."""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

from amqtt.adapters import BufferReader
from amqtt.errors import AMQTTError, CodecError, MQTTError, NoDataError
from amqtt.mqtt.packet import CONNECT, MQTTFixedHeader

from broker.errors import MalformedPacket

# What amqtt's packet codecs raise on bytes that are no packet.
CODEC_ERRORS = (AMQTTError, MQTTError, CodecError, NoDataError, struct.error, ValueError)


PROTOCOL_LEVEL = 4  # MQTT 3.1.1


class Packet(NamedTuple):
    """A packet as received: first byte, everything after the fixed header, and what it took of the budget."""

    first: int
    body: memoryview
    cost_bytes: int


class Publish(NamedTuple):
    """A PUBLISH packet, taken apart. `packet_id` is its two bytes, or empty at QoS 0."""

    topic: str
    packet_id: bytes
    payload: memoryview
    qos: int
    retain: bool


def parse_publish(first: int, body: memoryview) -> Publish:
    """Take a PUBLISH packet apart (MQTT 3.1.1, section 3.3); the payload is not copied."""
    qos = first >> 1 & 3
    topic_end = 2 + int.from_bytes(body[:2], "big")
    start = topic_end + (2 if qos else 0)
    if qos == 3 or start > len(body) or len(body) < 2:
        raise MalformedPacket(f"PUBLISH with QoS {qos} and a topic that ends at byte {start} of {len(body)}")
    if qos and not any(body[topic_end:start]):
        raise MalformedPacket("PUBLISH with packet identifier 0")
    try:
        topic = bytes(body[2:topic_end]).decode()
    except UnicodeDecodeError as error:
        raise MalformedPacket("PUBLISH with a topic that is not UTF-8") from error
    if topic.startswith("$") or not is_topic(topic):
        raise MalformedPacket(f"PUBLISH on topic {topic!r}, which no client may publish on")
    return Publish(topic, bytes(body[topic_end:start]), body[start:], qos, bool(first & 1))


def is_topic(topic: str | None) -> bool:
    """Whether messages can be published on this topic (section 4.7)."""
    return bool(topic) and not any(char in str(topic) for char in "+#\0")


def parse_packet_id(body: memoryview) -> int:
    """The packet identifier that is all of an acknowledgement."""
    if len(body) != 2:
        raise MalformedPacket(f"acknowledgement with {len(body)} bytes, expected 2")
    return int.from_bytes(body, "big")


async def decode_filters(kind: type[Any], fixed: MQTTFixedHeader, body: memoryview) -> Any:
    """Decode SUBSCRIBE or UNSUBSCRIBE with amqtt's codec."""
    try:
        packet = await kind.from_stream(BufferReader(bytes(body)), fixed_header=fixed)
    except CODEC_ERRORS as error:
        raise MalformedPacket(f"{kind.__name__}: {error}") from error
    if not packet.payload.topics or packet.bytes_length != len(fixed.to_bytes()) + len(body):
        raise MalformedPacket(f"{kind.__name__} without topic filters or with bytes left over")
    if packet.variable_header.packet_id == 0:
        raise MalformedPacket(f"{kind.__name__} with packet identifier 0")
    return packet


def check_connect(first: int, body: memoryview) -> None:
    """Whether this is a CONNECT packet whose fields fill it exactly (section 3.1)."""
    if first != CONNECT << 4:
        raise MalformedPacket(f"the first packet is 0x{first:02x}, expected CONNECT")
    if len(body) > 6 and body[6] != PROTOCOL_LEVEL:
        return  # amqtt answers that with a CONNACK
    flags, end = (body[7], 10) if len(body) > 10 else (0, 0)
    will, password, user = flags >> 2 & 1, flags >> 6 & 1, flags >> 7
    for _ in range(1 + 2 * will + password + user):
        end += 2 + int.from_bytes(body[end : end + 2], "big")
    if end != len(body):
        raise MalformedPacket(f"CONNECT whose fields end at byte {end} of {len(body)}")
