"""PUBLISH packets of MQTT 3.1.1 as bytes, and their sizes: as both sides of the bus write, read and count them."""

from __future__ import annotations

from typing import NamedTuple

PUBLISH = 0x30
MAX_LENGTH = 268_435_455
"""The largest remaining length (section 2.2.3)."""


class Publish(NamedTuple):
    """The body of a PUBLISH packet, taken apart; its topic is as it came, its identifier empty at QoS 0."""

    topic: bytes
    packet_id: bytes
    payload: memoryview


def read_publish(first: int, body: memoryview) -> Publish:
    """Take a PUBLISH packet apart (section 3.3); the payload is not copied.

    Raises:
        ValueError: it ends within a field, or has QoS 3.
    """
    qos = first >> 1 & 3
    end = 2 + int.from_bytes(body[:2], "big")
    start = end + (2 if qos else 0)
    if qos == 3 or start > len(body) or len(body) < 2:
        raise ValueError(f"PUBLISH with QoS {qos} and a topic that ends at byte {start} of {len(body)}")
    return Publish(bytes(body[2:end]), bytes(body[end:start]), body[start:])


def publish_head(
    topic: bytes, payload_bytes: int, qos: int, packet_id: int, *, dup: bool = False, retain: bool = False
) -> bytes:
    """Everything of a PUBLISH packet before its payload; QoS 0 has no identifier."""
    fields = len(topic).to_bytes(2, "big") + topic + (packet_id.to_bytes(2, "big") if qos else b"")
    first = PUBLISH | dup << 3 | qos << 1 | retain
    return bytes((first,)) + length_bytes(len(fields) + payload_bytes) + fields


def length_bytes(length: int) -> bytes:
    """A remaining length (section 2.2.3): 7 bits a byte, the lowest first."""
    if length < 128:
        return bytes((length,))
    if length < 1 << 14:
        return bytes((length & 127 | 128, length >> 7))
    digits = bytearray()
    while length >= 128:
        digits.append(length & 127 | 128)
        length >>= 7
    return bytes((*digits, length))


def publish_packet_bytes(topic: str, payload_bytes: int, qos: int) -> int:
    """Size of the PUBLISH packet that carries `payload_bytes` on `topic` (section 3.3)."""
    return packet_bytes(publish_body_bytes(topic, payload_bytes, qos))


def publish_body_bytes(topic: str, payload_bytes: int, qos: int) -> int:
    """Its remaining length: what brokers have a limit for."""
    return 2 + len(topic.encode()) + (2 if qos > 0 else 0) + payload_bytes


def packet_bytes(length: int) -> int:
    """Size of a whole packet from its remaining length: 1 + its digits + the length."""
    digits = 1 if length < 1 << 7 else 2 if length < 1 << 14 else 3 if length < 1 << 21 else 4
    return 1 + digits + length
