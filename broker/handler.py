"""One connected client: its packets in order of arrival, answered as MQTT 3.1.1 wants it."""

from __future__ import annotations

import asyncio
from typing import Any, Protocol

from amqtt.mqtt.packet import (
    DISCONNECT,
    PINGREQ,
    PUBACK,
    PUBCOMP,
    PUBLISH,
    PUBREC,
    PUBREL,
    SUBSCRIBE,
    UNSUBSCRIBE,
)
from amqtt.mqtt.protocol.broker_handler import BrokerProtocolHandler
from amqtt.session import Session

from jouleswarm.broker.connection import Connection
from jouleswarm.broker.deliveries import INFLIGHT_LIMIT, Deliveries
from jouleswarm.broker.errors import MalformedPacket
from jouleswarm.broker.limits import REPLIES, Budget, Limits
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.packets import Packet, parse_packet_id, parse_publish, parse_subscribe, parse_unsubscribe
from jouleswarm.broker.publication import Publication
from jouleswarm.common.wire.mqtt import length_bytes, packet_bytes

# What else the first byte of a packet must hold (section 2.2.2).
_REQUIRED_FLAGS = {
    PUBACK: 0,
    PUBREC: 0,
    PUBREL: 2,
    PUBCOMP: 0,
    SUBSCRIBE: 2,
    UNSUBSCRIBE: 2,
    PINGREQ: 0,
    DISCONNECT: 0,
}
_DUP = 8
_PINGRESP = b"\xd0\x00"
_SUBACK, _UNSUBACK = b"\x90", b"\xb0\x02"
_PUBACK, _PUBREC, _PUBCOMP = b"\x40\x02", b"\x50\x02", b"\x70\x02"


class Exchange(Protocol):
    """The broker as one of its connections sees it."""

    limits: Limits
    meter: BrokerMeter
    budget: Budget
    plugins_manager: Any

    def patience_s(self, handler: ClientHandler) -> float:
        """How long a client may take nothing, seconds."""

    async def accept(self, sender: Session, publication: Publication, *, retain: bool) -> None:
        """Take a message for whoever has subscribed to it."""

    def add_subscription(self, subscription: tuple[str, int], session: Session) -> int:
        """The QoS that is granted, or 0x80."""

    async def deliver_retained(self, handler: ClientHandler, topic_filter: str, qos: int) -> None:
        """Send what is kept for a new subscription."""

    def remove_subscription(self, topic_filter: str, session: Session) -> None:
        """Forget one."""


class ClientHandler(BrokerProtocolHandler):  # type: ignore[misc]
    """amqtt's handler with a delivery path of its own (see docs/broker.md for what is overridden and why)."""

    def __init__(self, broker: Exchange, connection: Connection, session: Session) -> None:
        super().__init__(broker.plugins_manager, session)
        self.connection = connection
        self.left = asyncio.Event()
        self.left_cleanly = False
        self._broker = broker
        self.deliveries = Deliveries(session, connection, broker.limits, broker.meter)
        self.deliver = self.deliveries.deliver

    async def serve(self) -> None:
        """Handle packets until the client disconnects.

        Raises:
            PeerGone: the connection ended without DISCONNECT.
            MalformedPacket: the client broke the protocol.
        """
        reader, writer = self.connection.reader, self.connection.writer
        while not self.left_cleanly:
            if writer.replies > REPLIES:
                await writer.caught_up()
            if (packet := reader.ready_packet()) is None:
                await reader.begun()
                packet = reader.ready_packet() or await reader.read_packet()
            if packet.first >> 4 == PUBLISH:
                await self._on_publish(packet)
            else:
                self._broker.meter.control(self.session.client_id, "in", packet_bytes(len(packet.body)))
                await self._on_control(packet.first, packet.body)

    def overdue(self, now_s: float) -> str | None:
        """Why this client must be dropped for taking nothing of what waits for it, if it must."""
        stall_s = self._broker.patience_s(self)
        return self.deliveries.overdue(now_s, stall_s) or self.connection.overdue(now_s, stall_s)

    @property
    def held_bytes(self) -> int:
        """What the broker holds for this client alone or with others."""
        return self.connection.held_bytes + self.deliveries.held_bytes

    async def _on_control(self, first: int, body: memoryview) -> None:
        kind, flags = first >> 4, first & (15 if self.session.level > 3 else 7)  # 3.1 has DUP with PUBREL too
        if _REQUIRED_FLAGS.get(kind) != flags:
            raise MalformedPacket(f"packet with first byte 0x{first:02x}, which no client may send here")
        if kind == PUBACK:
            self.deliveries.on_puback(parse_packet_id(body))
        elif kind == PUBREC:
            self.deliveries.on_pubrec(parse_packet_id(body))
        elif kind == PUBCOMP:
            self.deliveries.on_pubcomp(parse_packet_id(body))
        elif kind == PUBREL:
            self.session.inflight_in.pop(parse_packet_id(body), None)
            self.connection.send(_PUBCOMP + body)
        elif kind == SUBSCRIBE:
            await self._on_subscribe(body)
        elif kind == UNSUBSCRIBE:
            self._on_unsubscribe(body)
        elif len(body):
            raise MalformedPacket(f"packet with first byte 0x{first:02x} and {len(body)} bytes more, expected none")
        elif kind == PINGREQ:
            self.connection.send(_PINGRESP)
        else:
            self.left_cleanly = True

    async def _on_publish(self, packet: Packet) -> None:
        try:
            message = parse_publish(packet.first, packet.body)
            if len(message.topic) > self._broker.limits.name_length:
                raise MalformedPacket(f"PUBLISH on a topic of {len(message.topic)} characters")
        except MalformedPacket:
            self._broker.budget.release(packet.cost_bytes)
            raise
        packet_id, taken = int.from_bytes(message.packet_id, "big"), self.session.inflight_in
        publication = Publication(message.topic, message.payload, message.qos, self._broker.budget, packet.cost_bytes)
        if message.qos == 2:  # first, so that it comes before what its sender may get of the message itself
            self.connection.send(_PUBREC + message.packet_id)
        try:
            meter, client_id, topic = self._broker.meter, self.session.client_id, message.topic
            sizes = len(message.payload), packet_bytes(len(packet.body))
            meter.count(client_id, topic, "in", *sizes)
            if packet.first & _DUP:
                meter.repeated(client_id, topic, "in", *sizes)
            if message.qos < 2 or packet_id not in taken:
                await self._broker.accept(self.session, publication, retain=message.retain)
        finally:
            publication.drop()
        if message.qos == 1:
            self.connection.send(_PUBACK + message.packet_id)
        elif message.qos == 2:
            taken[packet_id] = True  # until its PUBREL: what comes by this identifier is the same message again

    async def _on_subscribe(self, body: memoryview) -> None:
        packet_id, subscriptions = parse_subscribe(body)
        granted = bytes(self._broker.add_subscription(each, self.session) for each in subscriptions)
        self.connection.send(_SUBACK + length_bytes(2 + len(granted)) + packet_id + granted)
        for (topic_filter, _), qos in zip(subscriptions, granted, strict=True):
            if qos < 128:
                if self.deliveries.waiting > INFLIGHT_LIMIT:
                    raise MalformedPacket("subscribed anew to more retained messages than it acknowledges")
                await self._broker.deliver_retained(self, topic_filter, qos)

    def _on_unsubscribe(self, body: memoryview) -> None:
        packet_id, filters = parse_unsubscribe(body)
        for topic_filter in filters:
            self._broker.remove_subscription(topic_filter, self.session)
        self.connection.send(_UNSUBACK + packet_id)

    # amqtt's handler interface

    async def stop(self) -> None:
        """Called by amqtt at shutdown and when a session expires."""
        self.connection.abort("closed by the broker")

    async def mqtt_publish(self, topic: str, data: bytes, qos: int | None, retain: bool, *_: Any) -> None:
        """amqtt's way to send a message to this client; does not wait for the acknowledgement."""
        self.deliver(Publication(topic, memoryview(data), qos or 0), qos or 0, retain=retain)
