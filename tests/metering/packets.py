"""MQTT packets made by hand."""

from __future__ import annotations

from jouleswarm.common.wire.mqtt import length_bytes


def text(value: str) -> bytes:
    return len(value.encode()).to_bytes(2, "big") + value.encode()


def packet(first: int, body: bytes = b"") -> bytes:
    return bytes((first,)) + length_bytes(len(body)) + body


def connect(client: str, version: int = 4) -> bytes:
    """Of MQTT 5 with a receive maximum of 9 among its properties."""
    properties = b"\x03\x21\x00\x09" if version == 5 else b""
    return packet(0x10, text("MQTT") + bytes((version, 2, 0, 60)) + properties + text(client))


def publish(topic: str, payload: bytes, *, first: int = 0x30, properties: bytes | None = None) -> bytes:
    """`properties`: of MQTT 5, without their length."""
    packet_id = b"\x00\x01" if first & 6 else b""
    held = b"" if properties is None else length_bytes(len(properties)) + properties
    return packet(first, text(topic) + packet_id + held + payload)
