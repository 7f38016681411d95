"""One connected client: its packets in order of arrival, its deliveries with their acknowledgements."""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from amqtt.mqtt.packet import (
    DISCONNECT,
    PINGREQ,
    PUBACK,
    PUBLISH,
    PUBREL,
    SUBSCRIBE,
    UNSUBSCRIBE,
    MQTTFixedHeader,
)
from amqtt.mqtt.protocol.broker_handler import BrokerProtocolHandler
from amqtt.mqtt.subscribe import SubscribePacket
from amqtt.mqtt.unsubscribe import UnsubscribePacket

from broker.connection import Connection
from broker.errors import MalformedPacket
from broker.limits import REPLIES
from broker.packets import Packet, decode_filters, parse_packet_id, parse_publish
from broker.publication import Publication

if TYPE_CHECKING:
    from broker.core import SwarmBroker

# Packet identifiers have 16 bits; the last few stay free.
INFLIGHT_LIMIT = 65_000

_REQUIRED_FLAGS = {PUBACK: 0, PUBREL: 2, SUBSCRIBE: 2, UNSUBSCRIBE: 2, PINGREQ: 0, DISCONNECT: 0}
_PINGRESP = b"\xd0\x00"


@dataclass(slots=True)
class Delivery:
    """A QoS 1 message on its way to one subscriber, kept under its packet identifier until the PUBACK."""

    publication: Publication | None  # None once written to a clean session: it is never sent again
    retain: bool
    begun: bool = False
    written: tuple[str, int, int] | None = None  # topic, payload and packet bytes, once written whole


class ClientHandler(BrokerProtocolHandler):  # type: ignore[misc]
    """amqtt's handler with a delivery path of its own (see README.md for what is overridden and why)."""

    def __init__(self, broker: SwarmBroker, connection: Connection) -> None:
        super().__init__(broker.plugins_manager)
        self.connection = connection
        self.left = asyncio.Event()
        self.left_cleanly = False
        self._broker = broker
        self._waiting: deque[tuple[Publication, bool]] = deque()
        self._acknowledged_s = 0.0
        self.kept_bytes = 0

    # Packets from the client

    async def serve(self) -> None:
        """Handle packets until the client disconnects.

        Raises:
            PeerGone: the connection ended without DISCONNECT.
            MalformedPacket: the client broke the protocol.
        """
        while not self.left_cleanly:
            if self.connection.writer.replies > REPLIES:
                await self.connection.writer.caught_up()
            packet = await self.connection.reader.read_packet()
            if packet.first >> 4 == PUBLISH:
                await self._on_publish(packet)
            else:
                await self._on_control(packet.first, packet.body)

    async def _on_control(self, first: int, body: memoryview) -> None:
        kind = first >> 4
        if _REQUIRED_FLAGS.get(kind) != first & 15:
            raise MalformedPacket(f"packet with first byte 0x{first:02x}, which no client may send here")
        if kind == PUBACK:
            self._on_puback(parse_packet_id(body))
        elif kind == PINGREQ:
            self.connection.send(_PINGRESP)
        elif kind == SUBSCRIBE:
            await self._on_subscribe(MQTTFixedHeader(kind, 2, len(body)), body)
        elif kind == UNSUBSCRIBE:
            await self._on_unsubscribe(MQTTFixedHeader(kind, 2, len(body)), body)
        elif kind == PUBREL:
            self.session.inflight_in.pop(parse_packet_id(body), None)
            self.connection.send(b"\x70\x02" + body[:2])
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
        publication = Publication(
            message.topic, message.payload, min(message.qos, 1), self._broker.budget, packet.cost_bytes
        )
        try:
            client_id, size = self.session.client_id, len(message.payload)
            self._broker.meter.received(client_id, message.topic, size, len(packet.body))
            if message.qos < 2 or packet_id not in taken:
                await self._broker.accept(self.session, publication, retain=message.retain)
        finally:
            publication.drop()
        if message.qos == 1:
            self.connection.send(b"\x40\x02" + message.packet_id)
        elif message.qos == 2:
            taken[packet_id] = True
            self.connection.send(b"\x50\x02" + message.packet_id)

    async def _on_subscribe(self, fixed: MQTTFixedHeader, body: memoryview) -> None:
        packet = await decode_filters(SubscribePacket, fixed, body)
        subscriptions = packet.payload.topics
        if any(qos > 2 for _, qos in subscriptions):
            raise MalformedPacket("SUBSCRIBE with a QoS above 2")
        granted = [await self._broker.add_subscription(each, self.session) for each in subscriptions]
        await self.mqtt_acknowledge_subscription(packet.variable_header.packet_id, granted)
        for (topic_filter, _), qos in zip(subscriptions, granted, strict=True):
            if qos < 128:
                if len(self._waiting) > INFLIGHT_LIMIT:
                    raise MalformedPacket("subscribed anew to more retained messages than it acknowledges")
                await self._broker.deliver_retained(self, topic_filter, qos)

    async def _on_unsubscribe(self, fixed: MQTTFixedHeader, body: memoryview) -> None:
        packet = await decode_filters(UnsubscribePacket, fixed, body)
        for topic_filter in packet.payload.topics:
            self._broker.remove_subscription(topic_filter, self.session)
        await self.mqtt_acknowledge_unsubscription(packet.variable_header.packet_id)

    # Deliveries to the client

    def deliver(self, publication: Publication, qos: int, *, retain: bool = False) -> None:
        """Queue a message for this client at QoS 0 or 1."""
        publication.hold()
        if qos == 0:
            self._transmit(publication, None, retain=retain)
        elif self._waiting or not self._has_window(publication):
            self._waiting.append((publication, retain))
        else:
            self._begin(publication, retain)

    def resume(self) -> None:
        """Send again what an earlier connection of this session left unacknowledged (MQTT 3.1.1, section 4.4)."""
        for packet_id, delivery in tuple(self.session.inflight_out.items()):
            self.kept_bytes += len(delivery.publication.payload)
            delivery.publication.hold()
            self._transmit(delivery.publication, packet_id, delivery, dup=delivery.begun, retain=delivery.retain)

    def suspend(self) -> list[Publication]:
        """Deliveries that never got a packet identifier, for the session to keep."""
        waiting, self._waiting = self._waiting, deque()
        return [publication for publication, _ in waiting]

    def overdue(self, now_s: float) -> str | None:
        """Why this client must be dropped for taking nothing of what waits for it, if it must."""
        stall_s = self._broker.patience_s(self)
        if self._waiting and now_s - self._acknowledged_s > stall_s:
            return f"it acknowledged nothing for {stall_s:g} s while {len(self._waiting)} messages waited for it"
        return self.connection.overdue(now_s, stall_s)

    @property
    def held_bytes(self) -> int:
        """What the broker holds for this client alone or with others."""
        waiting = sum(len(publication.payload) for publication, _ in self._waiting)
        return self.connection.held_bytes + waiting

    def _has_window(self, publication: Publication) -> bool:
        # A clean session's payload is forgotten when written; a persistent one's is kept until the PUBACK.
        kept = 0 if self.session.clean_session else self.kept_bytes + len(publication.payload)
        return len(self.session.inflight_out) < INFLIGHT_LIMIT and (
            kept <= self._broker.limits.offline_bytes or not self.session.inflight_out
        )

    def _begin(self, publication: Publication, retain: bool) -> None:
        if not self.session.inflight_out:
            self._acknowledged_s = self._loop.time()
        if not self.session.clean_session:
            self.kept_bytes += len(publication.payload)
        packet_id = self.session.next_packet_id
        delivery = Delivery(publication, retain)
        self.session.inflight_out[packet_id] = delivery
        self._transmit(publication, packet_id, delivery, retain=retain)

    def _transmit(
        self,
        publication: Publication,
        packet_id: int | None,
        delivery: Delivery | None = None,
        *,
        dup: bool = False,
        retain: bool = False,
    ) -> None:
        header = publication.header(packet_id, dup=dup, retain=retain)
        size = len(header) + len(publication.payload)
        client_id, forgets = self.session.client_id, self.session.clean_session

        def done(written: int) -> None:
            if delivery is not None:
                delivery.begun = delivery.begun or written > 0
                if forgets:
                    delivery.publication = None
            if written == size:
                whole = publication.topic, len(publication.payload), size
                self._broker.meter.delivered(client_id, *whole)
                if delivery is not None:
                    delivery.written = whole
            else:
                self._broker.meter.event("aborted_deliveries")
                self._broker.meter.event("aborted_bytes", written)
            publication.drop()

        self.connection.send(header, publication.payload, done, retained=retain)

    def _on_puback(self, packet_id: int) -> None:
        delivery = self.session.inflight_out.pop(packet_id, None)
        if delivery is None:
            return
        self._acknowledged_s = self._loop.time()
        if delivery.written is not None:
            self._broker.meter.acknowledged(self.session.client_id, *delivery.written)
        if delivery.publication is not None:
            self.kept_bytes -= len(delivery.publication.payload)
        while self._waiting and self._has_window(self._waiting[0][0]):
            self._begin(*self._waiting.popleft())

    # amqtt's handler interface

    async def stop(self) -> None:
        """Called by amqtt at shutdown and when a session expires."""
        self.connection.abort("closed by the broker")

    async def mqtt_publish(self, topic: str, data: bytes, qos: int | None, retain: bool, *_: Any) -> None:
        """amqtt's way to send a message to this client; does not wait for the PUBACK."""
        self.deliver(Publication(topic, memoryview(data), qos or 0), min(qos or 0, 1), retain=retain)
