"""Writes down what a meter counts, as long as it counts, in a thread: nothing waits for the disk."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Mapping, Sequence

from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.counters import Counts, Key
from jouleswarm.metering.directory import Directory
from jouleswarm.metering.tally import rows_of
from jouleswarm.metering.windows import Windows
from jouleswarm.metering.written import Told

_EVERY_S = 2.0

log = logging.getLogger("jouleswarm.metering")


class Recorder:
    """Every two seconds, and at the end; a full disk is no reason to cut anybody off, but at the end it is an error."""

    def __init__(
        self,
        directory: Directory,
        counts: Callable[[], Mapping[Key, Counts]],
        window_s: float,
        told: Callable[[], Sequence[Told]] = tuple,
    ) -> None:
        """
        Args:
            directory: to write to.
            counts: what has been counted by now.
            window_s: of time, for counts by window.
            told: what clients have told of themselves by now.
        """
        self._directory, self._counts, self._told = directory, counts, told
        self._windows = Windows(time.time(), window_s)
        self._before: tuple[Mapping[Key, Counts], Sequence[Told]] | None = None

    async def record(self, stop: asyncio.Event) -> None:
        """Write until then."""
        while not stop.is_set():
            try:
                await self._write()
            except RunError as error:
                log.warning("%s; going on, and trying again", error)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), _EVERY_S)

    async def end(self) -> None:
        """Write what is left, and that this is all.

        Raises:
            RunError: it can't be written.
        """
        await self._write()
        self._directory.end()

    async def _write(self) -> None:
        """If there is anything new."""
        counts, told = self._counts(), self._told()
        if (now := (counts, told)) == self._before:
            return
        rows = rows_of(counts, self._directory.rules)
        self._windows.add(time.time(), rows)
        await asyncio.to_thread(self._directory.write, rows, self._windows.all(), told)
        self._before = now
