"""Messages on their way to one client, until it has acknowledged them (MQTT 3.1.1, sections 4.3 and 4.4)."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import NamedTuple

from amqtt.session import Session

from jouleswarm.broker.connection import Connection
from jouleswarm.broker.errors import MalformedPacket
from jouleswarm.broker.limits import Limits
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.outcome import Delivery, DeliveryOutcome
from jouleswarm.broker.publication import Publication

# Packet identifiers have 16 bits; the last few stay free.
INFLIGHT_LIMIT = 65_000
_PUBREL = b"\x62\x02"


class Message(NamedTuple):
    """A publication for one client, and how it gets it: the lower of the QoS published and granted."""

    publication: Publication
    qos: int
    retain: bool = False


class Deliveries:
    """Sends to one connection; what is not acknowledged stays in its session, in the order of sending."""

    def __init__(self, session: Session, connection: Connection, limits: Limits, meter: BrokerMeter) -> None:
        self._session, self._connection, self._limits, self._meter = session, connection, limits, meter
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Message] = deque()
        self._acknowledged_s = 0.0
        self.kept_bytes = 0

    @property
    def waiting(self) -> int:
        """Messages that wait for others to be acknowledged."""
        return len(self._waiting)

    @property
    def held_bytes(self) -> int:
        """Payloads that wait for that."""
        return sum(len(message.publication.payload) for message in self._waiting)

    def deliver(self, publication: Publication, qos: int, *, retain: bool = False) -> None:
        """Send a message, or queue it behind others."""
        publication.hold()
        if qos == 0:
            self._transmit(publication, 0, 0, None, retain=retain)
        elif self._waiting or not self._has_window(publication):
            self._waiting.append(Message(publication, qos, retain))
        else:
            self._begin(publication, qos, retain)

    def resume(self) -> None:
        """Send again what an earlier connection of this session left unacknowledged (section 4.4)."""
        for packet_id, delivery in tuple(self._session.inflight_out.items()):
            publication = delivery.publication
            if publication is None:
                self._release(packet_id)
                continue
            self.kept_bytes += len(publication.payload)
            publication.hold()
            self._transmit(publication, delivery.qos, packet_id, delivery, dup=delivery.begun, retain=delivery.retain)

    def suspend(self) -> list[Message]:
        """Deliveries that never got a packet identifier, for the session to keep."""
        waiting, self._waiting = self._waiting, deque()
        return list(waiting)

    def overdue(self, now_s: float, stall_s: float) -> str | None:
        """Why this client must be dropped for acknowledging nothing while messages wait, if it must."""
        if self._waiting and now_s - self._acknowledged_s > stall_s:
            return f"it acknowledged nothing for {stall_s:g} s while {len(self._waiting)} messages waited for it"
        return None

    # Acknowledgements

    def on_puback(self, packet_id: int) -> None:
        """The end of a delivery at QoS 1."""
        if (delivery := self._found(packet_id, 1)) is not None:
            self._settle(delivery)
            self._end(packet_id)

    def on_pubrec(self, packet_id: int) -> None:
        """A delivery at QoS 2 was received: it is never sent again, and counted as acknowledged."""
        delivery = self._found(packet_id, 2)
        if delivery is not None and not delivery.received:
            delivery.received = True
            self._settle(delivery)
        self._release(packet_id)

    def on_pubcomp(self, packet_id: int) -> None:
        """The end of a delivery at QoS 2."""
        delivery = self._found(packet_id, 2)
        if delivery is None:
            return
        if not delivery.received:
            raise MalformedPacket(f"PUBCOMP of {packet_id} before its PUBREC")
        self._end(packet_id)

    def _found(self, packet_id: int, qos: int) -> Delivery | None:
        delivery: Delivery | None = self._session.inflight_out.get(packet_id)
        if delivery is not None and delivery.qos != qos:
            raise MalformedPacket(f"acknowledgement of QoS {qos} for {packet_id}, sent at QoS {delivery.qos}")
        return delivery

    def _settle(self, delivery: Delivery) -> None:
        if delivery.written is not None:
            topic, *counts = delivery.written
            self._meter.count(self._session.client_id, topic, "acked", *counts)
        if delivery.publication is not None:
            if not self._session.clean_session:
                self.kept_bytes -= len(delivery.publication.payload)
            delivery.publication = None

    def _release(self, packet_id: int) -> None:
        self._acknowledged_s = self._loop.time()
        self._connection.send(_PUBREL + packet_id.to_bytes(2, "big"))

    def _end(self, packet_id: int) -> None:
        del self._session.inflight_out[packet_id]
        self._acknowledged_s = self._loop.time()
        while self._waiting and self._has_window(self._waiting[0].publication):
            self._begin(*self._waiting.popleft())

    # Sending

    def _has_window(self, publication: Publication) -> bool:
        # A clean session's payload is forgotten when written; a persistent one's is kept until it is acknowledged.
        kept = 0 if self._session.clean_session else self.kept_bytes + len(publication.payload)
        return len(self._session.inflight_out) < INFLIGHT_LIMIT and (
            kept <= self._limits.offline_bytes or not self._session.inflight_out
        )

    def _begin(self, publication: Publication, qos: int, retain: bool) -> None:
        if not self._session.inflight_out:
            self._acknowledged_s = self._loop.time()
        if not self._session.clean_session:
            self.kept_bytes += len(publication.payload)
        packet_id = self._session.next_packet_id
        delivery = Delivery(publication, qos, retain)
        self._session.inflight_out[packet_id] = delivery
        self._transmit(publication, qos, packet_id, delivery, retain=retain)

    def _transmit(
        self,
        publication: Publication,
        qos: int,
        packet_id: int,
        delivery: Delivery | None,
        *,
        dup: bool = False,
        retain: bool = False,
    ) -> None:
        header = publication.header(qos, packet_id, dup=dup, retain=retain)
        outcome = DeliveryOutcome(self._meter, self._session, publication, delivery, len(header), dup)
        self._connection.send(header, publication.payload, outcome, retained=retain)
