"""A meter from its start to its end: what `jouleswarm meter proxy` and `meter serve` do."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from urllib.parse import urlsplit

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.errors import ConfigurationError, RunError, usable
from jouleswarm.common.meter.counters import Counts, Key
from jouleswarm.common.meter.tally import Row, rows_of
from jouleswarm.common.process import on_hangup
from jouleswarm.common.wire.rules import Rule, read_rules
from jouleswarm.common.wire.topics import run_name
from jouleswarm.metering.proxy import Proxy
from jouleswarm.metering.written import METER, RULES, write_rows

_EVERY_S = 2.0

log = logging.getLogger("jouleswarm.metering")


def parse_listen(text: str) -> tuple[str | None, int]:
    """(host, port) of HOST:PORT or :PORT, which is every address (None).

    Raises:
        ConfigurationError: it is something else.
    """
    with contextlib.suppress(ValueError):
        parts = urlsplit(f"//{text}")
        if parts.port is not None and parts.netloc == text and "@" not in text:
            return parts.hostname, parts.port
    raise ConfigurationError(f"--listen {text!r}: expected HOST:PORT, or :PORT for every address of this machine")


def make_folder(out: Path, name: str | None, links: Path) -> Path:
    """A folder for what is metered, with the rules as they are now.

    Raises:
        ConfigurationError: it holds counts already, or can't be made, or a rule can't be.
    """
    read_rules(links)
    folder = out / run_name(name or f"meter-{datetime.now():%Y%m%d-%H%M%S}")
    with usable("output folder", folder):
        if (folder / METER).exists():
            raise ConfigurationError(f"{folder} holds what was metered before, expected another --run-id or --out")
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / RULES, links.read_bytes())
    return folder


class Recorder:
    """Writes down what a meter counts, every two seconds and at the end, in a thread: nothing waits for the disk."""

    def __init__(self, folder: Path, links: Path, counts: Callable[[], Mapping[Key, Counts]]) -> None:
        """`counts`: what has been counted by now."""
        self._folder, self._links, self._counts = folder, links, counts
        self.rules: Sequence[Rule] = read_rules(links)
        self._before: Mapping[Key, Counts] | None = None

    def read_rules(self) -> bool:
        """Go by the file as it is now, for all that was counted, and say so; whether it can be."""
        try:
            self.rules = read_rules(self._links)
        except ConfigurationError as error:
            log.warning("%s; the rules before stay", error)
            return False
        write_whole(self._folder / RULES, self._links.read_bytes())
        log.warning("%d rules of %s from now on", len(self.rules), self._links)
        self._before = None
        return True

    async def record(self, stop: asyncio.Event, check: Callable[[], None] = lambda: None) -> None:
        """Write until then; a full disk is no reason to cut anybody off. `check` raises an error where one is."""
        while not stop.is_set():
            check()
            try:
                if (counts := self._counts()) != self._before:
                    await self._write(counts)
                    self._before = counts
            except RunError as error:
                log.warning("%s; going on, and trying again", error)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), _EVERY_S)

    async def end(self) -> list[Row]:
        """Write what there is at the end, where that can't be is an error."""
        return await self._write(self._counts())

    async def _write(self, counts: Mapping[Key, Counts]) -> list[Row]:
        rules = self.rules

        def written() -> list[Row]:
            rows = rows_of(counts, rules)
            write_rows(self._folder, rows, rules)
            return rows

        return await asyncio.to_thread(written)


def ending(read_anew: Callable[[], object]) -> asyncio.Event:
    """Set by a signal to end; SIGHUP has the rules read anew."""
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) != signal.SIG_IGN:
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
    on_hangup(read_anew, stop.set)
    return stop


async def serve(
    proxy: Proxy, listen: tuple[str | None, int], recorder: Recorder, on_listening: Callable[[int], None]
) -> list[Row]:
    """Have a proxy meter until a signal to end. Gives the last rows.

    Raises:
        RunError: it can't listen, or can't write.
    """
    stop = ending(recorder.read_rules)
    async with proxy.listening(*listen) as port:
        on_listening(port)
        await recorder.record(stop)
    return await recorder.end()
