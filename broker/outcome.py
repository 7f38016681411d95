"""What becomes of a delivery's packet, and what the broker counts of it."""

from __future__ import annotations

from dataclasses import dataclass

from amqtt.session import Session

from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.publication import Publication


@dataclass(slots=True)
class Delivery:
    """A QoS 1 or 2 message under its packet identifier, until PUBACK or PUBCOMP."""

    publication: Publication | None  # None once it is never sent again: written to a clean session, or received
    qos: int
    retain: bool
    begun: bool = False
    received: bool = False  # PUBREC has come, and PUBREL is out
    written: tuple[str, int, int] | None = None  # topic, payload and packet bytes, once written whole


class DeliveryOutcome:
    """Told by the `PacketWriter` what it does with one packet."""

    __slots__ = ("_delivery", "_dup", "_meter", "_packet_bytes", "_publication", "_session")

    def __init__(
        self,
        meter: BrokerMeter,
        session: Session,
        publication: Publication,
        delivery: Delivery | None,
        header_bytes: int,
        dup: bool,
    ) -> None:
        self._meter, self._session = meter, session
        self._publication, self._delivery, self._dup = publication, delivery, dup
        self._packet_bytes = header_bytes + len(publication.payload)

    def going(self) -> None:
        """The kernel is given all that is left of it."""
        if self._meter.outlives:
            publication = self._publication
            self._meter.announce(
                self._session.client_id, publication.topic, len(publication.payload), self._packet_bytes
            )

    def stayed(self) -> None:
        """The kernel did not take it all."""
        if self._meter.outlives:
            self._meter.withdraw(self._session.client_id, self._publication.topic)

    def ended(self, written: int) -> None:
        """It was written, or what of it could be before the connection ended."""
        delivery, publication = self._delivery, self._publication
        if delivery is not None:
            delivery.begun = delivery.begun or written > 0
            if self._session.clean_session:
                delivery.publication = None
        if written == self._packet_bytes:
            client_id, topic, payload_bytes = self._session.client_id, publication.topic, len(publication.payload)
            self._meter.count(client_id, topic, "out", payload_bytes, written)
            if self._dup:
                self._meter.repeated(client_id, topic, "out", payload_bytes, written)
            if delivery is not None:
                delivery.written = topic, payload_bytes, written
        else:
            self._meter.event("aborted_deliveries")
            self._meter.event("aborted_bytes", written)
        publication.drop()
