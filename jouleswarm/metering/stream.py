"""The two byte streams of a connection, taken apart as their pieces come; what is held of them is bounded."""

from __future__ import annotations

from collections.abc import Callable

from jouleswarm.common.meter.tally import Direction, Kind, Tally
from jouleswarm.metering.packets import CONNACK, CONNECT, PUBLISH, Packet, read_packet

_MOST_ALIAS_BYTES = 1024 * 1024


class Stream:
    """One direction. A packet is told of once its last byte has passed; the first that is none spoils the rest."""

    def __init__(self, whole: Callable[[Packet], None], unparsed: Callable[[int], None]) -> None:
        """`unparsed`: told of bytes in no whole packet."""
        self._whole, self._unparsed = whole, unparsed
        self.version = 0
        self._packet: Packet | None = None
        self._left = 0  # bytes of it that have not come
        self._begun = b""  # of a packet that does not tell what it is yet
        self._is_spoilt = False
        self._aliases: dict[int, str] = {}
        self._alias_bytes = 0

    def feed(self, piece: bytes | memoryview) -> None:
        """Count what has passed."""
        if self._is_spoilt:
            self._unparsed(len(piece))
            return
        view, self._begun = memoryview(self._begun + piece if self._begun else piece), b""
        at, end = 0, len(view)
        if self._packet is not None:
            at = min(self._left, end)
            self._left -= at
            if self._left:
                return
            packet, self._packet = self._packet, None
            self._whole(packet)
        while at < end:
            try:
                begun = self._read(view[at:])
            except ValueError:
                self._is_spoilt = True
                self._unparsed(end - at)
                return
            if begun is None:
                self._begun = bytes(view[at:])
                return
            at += begun.packet_bytes
            if at > end:
                self._packet, self._left = begun, at - end
                return
            self._whole(begun)

    def end(self) -> None:
        """No more will come: what was begun and not ended is in no packet."""
        begun = self._packet.packet_bytes - self._left if self._packet else len(self._begun)
        if begun:
            self._unparsed(begun)
        self._packet, self._left, self._begun = None, 0, b""

    def _read(self, view: memoryview) -> Packet | None:
        packet = read_packet(view, self.version)
        if packet is None or not packet.alias:
            return packet
        if not packet.topic:
            if packet.alias not in self._aliases:
                raise ValueError(f"topic alias {packet.alias}, which stands for nothing")
            return packet._replace(topic=self._aliases[packet.alias])
        self._alias_bytes += len(packet.topic) - len(self._aliases.get(packet.alias, ""))
        if self._alias_bytes > _MOST_ALIAS_BYTES:
            raise ValueError("topic aliases for more than is held")
        self._aliases[packet.alias] = packet.topic
        return packet


class Connection:
    """Both directions of one client's connection, into a tally."""

    def __init__(self, tally: Tally) -> None:
        self._tally, self.client = tally, ""
        self.sent = Stream(self._on_sent, lambda count: self._count("in", "unparsed", count))
        self.received = Stream(self._on_received, lambda count: self._count("out", "unparsed", count))

    def end(self) -> None:
        """The connection is no more."""
        self.sent.end()
        self.received.end()

    def _on_sent(self, packet: Packet) -> None:
        if packet.kind == CONNECT and not self.sent.version:
            self.client = packet.client
            self.sent.version = self.received.version = packet.version
        self._on_packet(packet, "in")

    def _on_received(self, packet: Packet) -> None:
        if packet.kind == CONNACK and packet.client:
            self.client = packet.client
        self._on_packet(packet, "out")

    def _on_packet(self, packet: Packet, direction: Direction) -> None:
        if packet.kind != PUBLISH:
            self._count(direction, "control", packet.packet_bytes)
            return
        kinds: tuple[Kind, ...] = ("publish", "repeat") if packet.is_repeat else ("publish",)
        for kind in kinds:
            self._tally.count(self.client, packet.topic, (direction, kind), packet.payload_bytes, packet.packet_bytes)

    def _count(self, direction: Direction, kind: Kind, packet_bytes: int) -> None:
        self._tally.count(self.client, "", (direction, kind), 0, packet_bytes)
