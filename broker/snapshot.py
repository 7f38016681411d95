"""The broker's counters as a retained message: totals every second, full rows for whoever asks."""

from __future__ import annotations

import asyncio

from broker.core import SwarmBroker
from broker.meter import by_link
from broker.publication import Publication
from common import topics
from common.snapshot import BrokerSnapshot

INTERVAL_S = 1.0


class SnapshotPublisher:
    """Publishes `common.snapshot.BrokerSnapshot` on `topics.BROKER_METER`."""

    def __init__(self, broker: SwarmBroker) -> None:
        self._broker = broker
        self._sequence = 0
        broker.on_ask = self.answer

    async def run(self) -> None:
        """Publish the totals whenever they have changed, once a second at most."""
        published = -1
        while True:
            changes = self._broker.meter.changes
            if changes != published:
                published = changes
                await self._publish(BrokerSnapshot(**self._totals()))
            await asyncio.sleep(INTERVAL_S)

    async def answer(self, asked: str) -> None:
        """Publish all rows at once. They hold everything received and delivered before the question."""
        await self._publish(BrokerSnapshot(**self._totals(), asked=asked, rows=tuple(self._broker.meter.rows())))

    def _totals(self) -> dict[str, object]:
        self._sequence += 1
        meter = self._broker.meter
        return {
            "sequence": self._sequence,
            "metering": meter.enabled,
            "clients": len(self._broker.handlers),
            "links": by_link(meter.totals().items()),
            "events": meter.event_counts(),
        }

    async def _publish(self, snapshot: BrokerSnapshot) -> None:
        payload = memoryview(snapshot.model_dump_json(exclude_none=True).encode())
        await self._broker.accept(None, Publication(topics.BROKER_METER, payload, 1), retain=True)
