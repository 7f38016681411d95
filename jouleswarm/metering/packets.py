"""What the beginning of an MQTT packet says of it, for 3.1, 3.1.1 and 5; section numbers are of MQTT 5. Pure."""

from __future__ import annotations

from typing import NamedTuple

CONNECT, CONNACK, PUBLISH, AUTH = 1, 2, 3, 15
MQTT_5 = 5
MOST_BEGINNING_BYTES = 256 * 1024
"""Of a packet whose properties are not there yet, no more is held."""
_PROTOCOLS = {b"MQIsdp": (3,), b"MQTT": (4, MQTT_5)}
_BRIDGE = 0x80  # what Mosquitto's bridges add to the version
_READ = {CONNECT, CONNACK, PUBLISH}  # more than their length
_FLAGS = {6: (2,), 8: (2,), 10: (2,), PUBLISH: range(16)}  # of PUBREL, SUBSCRIBE, UNSUBSCRIBE; else 0 (2.1.3)


def _firsts(*kinds: int) -> frozenset[int]:
    """What packets of these kinds can begin with."""
    return frozenset(kind << 4 | flags for kind in kinds for flags in _FLAGS.get(kind, (0,)))


_FIRSTS = {0: _firsts(CONNECT), 3: _firsts(*range(1, 15)), 4: _firsts(*range(1, 15)), MQTT_5: _firsts(*range(1, 16))}
_ALIAS, _ASSIGNED_ID = 0x23, 0x12
# Lengths of properties (2.2.2.2) that are numbers; the others are a variable number, a string, or two of them.
_NUMBERS = (
    dict.fromkeys((0x01, 0x17, 0x19, 0x24, 0x25, 0x28, 0x29, 0x2A), 1)
    | dict.fromkeys((0x13, 0x21, 0x22, _ALIAS), 2)
    | dict.fromkeys((0x02, 0x11, 0x18, 0x27), 4)
)
_STRINGS = (0x03, 0x08, 0x09, _ASSIGNED_ID, 0x15, 0x16, 0x1A, 0x1C, 0x1F)
_SUBSCRIPTION, _USER = 0x0B, 0x26


class Packet(NamedTuple):
    """One packet; what its kind does not have is empty."""

    kind: int
    """1 is CONNECT, and so on (2.1.2)."""
    packet_bytes: int
    topic: str = ""
    alias: int = 0
    """Stands for the topic, which may be empty then (3.3.2.3.4); 0: none."""
    payload_bytes: int = 0
    is_repeat: bool = False
    """DUP: the sender may have sent it before (3.3.1.1)."""
    version: int = 0
    """Of CONNECT."""
    client: str = ""
    """Of CONNECT; of CONNACK, the id that the broker gives to a client without one."""


class _More(ValueError):
    """The bytes end within a field."""


class _Fields:
    """Fields one after the other."""

    def __init__(self, view: memoryview) -> None:
        self._view, self.at = view, 0

    def take(self, count: int) -> memoryview:
        if self.at + count > len(self._view):
            raise _More
        self.at += count
        return self._view[self.at - count : self.at]

    def number(self, count: int = 1) -> int:
        return int.from_bytes(self.take(count), "big")

    def text(self) -> bytes:
        return bytes(self.take(self.number(2)))

    def length(self) -> int:
        """A variable byte integer (1.5.5)."""
        value = 0
        for shift in (0, 7, 14, 21):
            digit = self.number()
            value |= (digit & 127) << shift
            if digit < 128:
                return value
        raise ValueError("a length of more than four bytes")

    def properties(self) -> dict[int, int | bytes]:
        """Numbers and strings by identifier (2.2.2)."""
        fields, found = _Fields(self.take(self.length())), dict[int, int | bytes]()
        try:
            while fields.at < len(fields._view):
                what = fields.number()
                if what in _NUMBERS:
                    found[what] = fields.number(_NUMBERS[what])
                elif what in _STRINGS:
                    found[what] = fields.text()
                elif what == _SUBSCRIPTION:
                    fields.length()
                elif what == _USER:
                    fields.text(), fields.text()
                else:
                    raise ValueError(f"a property {what}")
        except _More:
            raise ValueError("properties that end within one") from None
        return found


def read_packet(view: memoryview, version: int) -> Packet | None:
    """The packet that begins with these bytes; None: more of them are needed to tell.

    Args:
        view: at least the packet's beginning; more may follow.
        version: of the connection (4 for MQTT 3.1.1); 0: not known, only a CONNECT can come.

    Raises:
        ValueError: it is no packet.
    """
    if (begins := _begins(view)) is None:
        return None
    first, length, at = begins
    if first not in _FIRSTS[version]:
        raise ValueError(f"a packet that begins with {first:#x}, in version {version}")
    kind, size = first >> 4, at + length
    if kind not in _READ:
        return Packet(kind, size)
    body = view[at:size]
    try:
        if kind == PUBLISH:
            return _publish(first, body, length, size, version)
        if kind == CONNECT:
            return _connect(body, size)
        if kind == CONNACK and version == MQTT_5:
            return _connack(body, size)
    except _More:
        if len(body) == length:
            raise ValueError("a packet that ends within a field") from None
        if len(view) > MOST_BEGINNING_BYTES:
            raise ValueError("properties that are too long") from None
        return None
    return Packet(kind, size)


def _begins(view: memoryview) -> tuple[int, int, int] | None:
    """The first byte, the remaining length (1.5.5), and where what it is of begins; None: not all of that is there."""
    length = 0
    for at in range(1, min(len(view), 5)):
        digit = view[at]
        length |= (digit & 127) << 7 * (at - 1)
        if digit < 128:
            return view[0], length, at + 1
    if len(view) < 5:
        return None
    raise ValueError("a length of more than four bytes")


def _publish(first: int, body: memoryview, length: int, size: int, version: int) -> Packet:
    end = 2 + int.from_bytes(body[:2], "big")
    at, alias = end + (2 if first & 6 else 0), 0
    if len(body) < max(2, at):
        raise _More
    if version == MQTT_5:
        fields = _Fields(body[at:])
        alias = int(fields.properties().get(_ALIAS, 0))
        at += fields.at
    topic = str(body[2:end], "utf-8")
    if first & 6 == 6 or "+" in topic or "#" in topic or not (topic or alias):
        raise ValueError(f"a PUBLISH that begins with {first:#x}, on {topic!r}")
    return Packet(PUBLISH, size, topic, alias, length - at, bool(first & 8))


def _connect(body: memoryview, size: int) -> Packet:
    fields = _Fields(body)
    name, version = fields.text(), fields.number() & ~_BRIDGE
    if version not in _PROTOCOLS.get(name, ()):
        raise ValueError(f"a CONNECT of {name!r} {version}")
    fields.take(3)
    if version == MQTT_5:
        fields.properties()
    return Packet(CONNECT, size, version=version, client=fields.text().decode())


def _connack(body: memoryview, size: int) -> Packet:
    fields = _Fields(body)
    fields.take(2)
    given = fields.properties().get(_ASSIGNED_ID, b"")
    assert isinstance(given, bytes)
    return Packet(CONNACK, size, client=given.decode())
