"""Writes down what a meter counts, as long as it counts, in a thread: nothing waits for the disk."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence

from jouleswarm.common.errors import JouleSwarmError, RunError
from jouleswarm.common.meter.cells import Counts, Key
from jouleswarm.common.meter.tally import rows_of
from jouleswarm.metering.directory import Directory
from jouleswarm.metering.windows import Windows
from jouleswarm.metering.written import Told

_EVERY_S = 2.0
_TIMES = 20  # as long as writing took, nothing is written: many rows must not hold the connections up

log = logging.getLogger("jouleswarm.metering")


class Recorder:
    """Every two seconds, less often where that takes long, and at the end.

    A full disk is no reason to cut anybody off; at the end it is an error.
    """

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
        self._lock, self._readings = threading.Lock(), 0
        self._before: tuple[Mapping[Key, Counts], Sequence[Told]] | None = None

    def read_rules(self) -> bool:
        """Go by the file of rules as it is now, for all that was counted, and say so; whether it can be.

        Windows that were counted before stay as they are.
        """
        with self._lock:
            counts, rules = self._counts(), self._directory.rules
            try:
                self._directory.read_rules()
            except JouleSwarmError as error:
                log.warning("%s; the rules before stay", error)
                return False
            self._windows.add(time.time(), rows_of(counts, rules))
            self._windows.begin_from(rows_of(counts, self._directory.rules))
            self._readings += 1
        log.warning("%d rules of %s from now on", len(self._directory.rules), self._directory.links)
        self._before = None
        return True

    async def record(self, stop: asyncio.Event, check: Callable[[], None] = lambda: None) -> None:
        """Write until then. `check` raises an error where one is."""
        due_s = 0.0
        while not stop.is_set():
            check()
            if (begun_s := time.monotonic()) >= due_s:
                try:
                    await self._write()
                except RunError as error:
                    log.warning("%s; going on, and trying again", error)
                due_s = time.monotonic() + _TIMES * (time.monotonic() - begun_s)
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
        readings = self._readings
        if await asyncio.to_thread(self._written, counts, told, readings) and readings == self._readings:
            self._before = now

    def _written(self, counts: Mapping[Key, Counts], told: Sequence[Told], readings: int) -> bool:
        """Whether they are: not if rules were read after these counts."""
        with self._lock:
            if readings != self._readings:
                return False
            rows = rows_of(counts, self._directory.rules)
            self._windows.add(time.time(), rows)
            self._directory.write(rows, self._windows.all(), told)
            return True
