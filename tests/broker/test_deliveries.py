"""Deliveries to a client that loses its connection at any moment: QoS 1 at least once, QoS 2 exactly once."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any

from amqtt.session import Session
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.broker.deliveries import Deliveries
from jouleswarm.broker.limits import Limits
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.packets import parse_publish
from jouleswarm.broker.publication import Publication

TOPIC = "jouleswarm/r/fl/sl/1/1/weights"


class Receiver:
    """A client with a persistent session, over connections that break: it answers `patience` packets on each."""

    def __init__(self, session: Session, meter: BrokerMeter) -> None:
        self._session, self._meter = session, meter
        self.took: list[bytes] = []
        self._known: set[int] = set()  # identifiers of QoS 2 messages that it has taken
        self._wire: list[bytes] = []
        self.connect()

    def connect(self) -> None:
        self._wire = []
        self.deliveries = Deliveries(self._session, self, Limits(), self._meter)  # type: ignore[arg-type]
        self.deliveries.resume()

    def send(
        self, header: bytes, payload: memoryview | None = None, outcome: Any = None, *, retained: bool = False
    ) -> None:
        self._wire.append(header + (payload or b""))
        if outcome is not None:
            outcome.ended(len(self._wire[-1]))

    def answer(self, patience: int) -> None:
        """Take this many packets in their order, and answer each; those after are lost with the connection."""
        for _ in range(patience):
            if not self._wire:
                return
            packet = self._wire.pop(0)
            if packet[0] == 0x62:
                packet_id = int.from_bytes(packet[2:4], "big")
                self._known.discard(packet_id)
                self.deliveries.on_pubcomp(packet_id)
                continue
            publish = parse_publish(packet[0], memoryview(packet)[2:])
            packet_id = int.from_bytes(publish.packet_id, "big")
            if packet_id not in self._known:
                self.took.append(bytes(publish.payload))
            if publish.qos == 1:
                self.deliveries.on_puback(packet_id)
            elif publish.qos == 2:
                self._known.add(packet_id)
                self.deliveries.on_pubrec(packet_id)


def persistent() -> Session:
    session = Session()
    session.client_id, session.clean_session = "agent-1", False
    return session


def once(payloads: Iterable[bytes]) -> list[bytes]:
    return list(dict.fromkeys(payloads))


@given(st.lists(st.tuples(st.integers(1, 2), st.integers(0, 3), st.booleans()), min_size=1, max_size=12))
def test_whatever_breaks_all_arrives_in_order_and_at_qos_2_exactly_once(steps: list[tuple[int, int, bool]]) -> None:
    async def scenario() -> None:
        session, meter = persistent(), BrokerMeter()
        receiver = Receiver(session, meter)
        for number, (qos, patience, breaks) in enumerate(steps):
            receiver.deliveries.deliver(Publication(TOPIC, memoryview(b"%d" % number), qos), qos)
            receiver.answer(patience)
            if breaks:
                receiver.connect()
        receiver.connect()
        receiver.answer(1000)
        assert once(receiver.took) == [b"%d" % number for number in range(len(steps))]
        exactly = [b"%d" % number for number, (qos, _, _) in enumerate(steps) if qos == 2]
        assert [each for each in receiver.took if each in exactly] == exactly
        assert session.inflight_out == {}
        assert receiver.deliveries.kept_bytes == 0
        (acked,) = (row.messages for row in meter.rows() if row.direction == "acked")
        assert acked == len(steps)

    asyncio.run(scenario())
