"""What SIGHUP has the broker read anew: the rules that it counts by, users and rights."""

from __future__ import annotations

import asyncio
import logging

from jouleswarm.broker.core import SwarmBroker
from jouleswarm.common.errors import ConfigurationError

logger = logging.getLogger("broker")


async def read_anew(heard: asyncio.Event, broker: SwarmBroker) -> None:
    """Read the files whenever `heard` is set. One that can't be is a line in the log, and what was before stays."""
    while True:
        await heard.wait()
        heard.clear()
        if (by_rule := broker.meter.by_rule) is not None:
            try:
                logger.warning("%d rules of %s from now on", broker.meter.read_rules(), by_rule.links)
            except ConfigurationError as error:
                logger.warning("%s; the rules before stay", error)
        if (guard := broker.guard) is not None:
            try:
                logger.warning("%s from now on", guard.read_anew())
            except ConfigurationError as error:
                logger.warning("%s; the users and rights before stay", error)
            else:
                await broker.take_out()
