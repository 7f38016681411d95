"""What the broker has moved, in a line now and then, for who started it by hand and looks at its shell."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable

from jouleswarm.broker.core import SwarmBroker
from jouleswarm.broker.meter import LinkKey, by_link

LOG = "broker.lines"
logger = logging.getLogger(LOG)
_EVERY_S = 10.0


async def tell(broker: SwarmBroker) -> None:
    """A line every ten seconds in which something was counted."""
    told = 0
    while True:
        await asyncio.sleep(_EVERY_S)
        if broker.meter.changes != told:
            told = broker.meter.changes
            logger.info("%s", line(len(broker.handlers), broker.meter.totals().items()))


def line(clients: int, totals: Iterable[tuple[LinkKey, tuple[int, int, int]]]) -> str:
    """`5 clients; delivered so far: uplink 1.2 MB in 30 messages, sidelink 0.1 MB in 4 messages`: of payload."""
    moved = [
        f"{link.value} {out['payload_bytes'] / 1e6:.1f} MB in {out['messages']} messages"
        for link, directions in by_link(totals).items()
        if (out := directions.get("out"))
    ]
    return f"{clients} clients; delivered so far: {', '.join(moved) or 'nothing'}"
