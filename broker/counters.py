"""What the broker tells about itself: limits, totals every second, rows for who asks (see `wire.broker_counters`)."""

from __future__ import annotations

import asyncio

from pydantic import BaseModel, ValidationError

from jouleswarm.broker.core import SwarmBroker
from jouleswarm.broker.meter import by_link
from jouleswarm.broker.publication import Publication
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.broker_counters import (
    PIECE_BYTES,
    BrokerLimits,
    BrokerSnapshot,
    CountersPiece,
    CountersRequest,
)
from jouleswarm.common.wire.messages import in_pieces

INTERVAL_S = 1.0
_ROWS_BYTES = PIECE_BYTES - 100_000  # the rest is for the refusals


class SnapshotPublisher:
    """Publishes under `$SYS/jouleswarm/`."""

    def __init__(self, broker: SwarmBroker) -> None:
        self._broker = broker
        self._sequence = 0
        broker.on_ask = self.answer

    async def announce(self) -> None:
        """Tell the limits, before anybody can connect."""
        await self._publish(topics.BROKER_LIMITS, BrokerLimits(message_bytes=self._broker.limits.message_bytes))

    async def run(self) -> None:
        """Publish the totals whenever they have changed, once a second at most; without metering there are none."""
        meter, published = self._broker.meter, -1
        while True:
            if meter.enabled and meter.changes != published:
                published = meter.changes
                await self._publish(topics.BROKER_METER, self._totals())
            await asyncio.sleep(INTERVAL_S)

    async def answer(self, question: bytes) -> None:
        """Publish all rows of a run at once. They hold everything received and delivered before the question."""
        try:
            asked = CountersRequest.model_validate_json(question)
        except ValidationError:
            self._broker.meter.refused("refused_questions", f"a question on {topics.BROKER_METER_ASK} that is none")
            return
        topic, meter = topics.broker_answer(asked.asked), self._broker.meter
        if not self._broker.has_receivers(topic):
            return
        pieces = list(in_pieces(meter.rows(asked.run), _ROWS_BYTES))
        for number, rows in enumerate(pieces, 1):
            piece = CountersPiece(
                asked=asked.asked,
                run=asked.run,
                piece=number,
                pieces=len(pieces),
                metering=meter.enabled,
                rows=tuple(rows),
                unmetered=meter.unmetered(asked.run),
                refusals=meter.refusals.lines(),
            )
            await self._publish(topic, piece, retain=False)

    def _totals(self) -> BrokerSnapshot:
        self._sequence += 1
        meter = self._broker.meter
        return BrokerSnapshot.model_validate(
            {
                "sequence": self._sequence,
                "clients": len(self._broker.handlers),
                "links": by_link(meter.totals().items()),
                "events": meter.event_counts(),
                "refusals": meter.refusals.lines(),
            }
        )

    async def _publish(self, topic: str, told: BaseModel, *, retain: bool = True) -> None:
        payload = memoryview(told.model_dump_json().encode())
        await self._broker.accept(None, Publication(topic, payload, 1), retain=retain)
