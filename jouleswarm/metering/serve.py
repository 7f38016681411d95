"""A metering proxy from its start to its end: what `jouleswarm meter proxy` does."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from urllib.parse import urlsplit

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.errors import ConfigurationError, RunError, usable
from jouleswarm.common.meter.counters import Counts, Key
from jouleswarm.common.wire.rules import Rule
from jouleswarm.common.wire.topics import run_name
from jouleswarm.metering.proxy import Proxy
from jouleswarm.metering.tally import Row, rows_of
from jouleswarm.metering.written import METER, RULES, write_rows

_EVERY_S = 2.0
_TIMES = 20  # as long as writing took, nothing is written: many rows must not hold the connections up
_SWITCH_S = 0.0005  # not Python's 5 ms: so long the connections wait for who writes, after each of their calls

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
        ConfigurationError: it holds counts already, or can't be made.
    """
    folder = out / run_name(name or f"meter-{datetime.now():%Y%m%d-%H%M%S}")
    with usable("output folder", folder):
        if (folder / METER).exists():
            raise ConfigurationError(f"{folder} holds what was metered before, expected another --run-id or --out")
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / RULES, links.read_bytes())
    return folder


async def serve(
    proxy: Proxy,
    listen: tuple[str | None, int],
    folder: Path,
    rules: Sequence[Rule],
    on_listening: Callable[[int], None],
) -> list[Row]:
    """Meter until a signal to end; the files are written every two seconds and at the end. Gives the last rows.

    Raises:
        ConfigurationError: it can't listen.
        RunError: it can't write.
    """
    sys.setswitchinterval(_SWITCH_S)
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as `nohup` has it
            loop.add_signal_handler(number, stop.set)
    async with proxy.listening(*listen) as port:
        on_listening(port)
        before: dict[Key, Counts] | None = None
        while not stop.is_set():
            begun_s = loop.time()
            if (counts := proxy.tally.counts()) != before:
                before = counts
                await _write_if_it_can(counts, folder, rules)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), max(_EVERY_S, _TIMES * (loop.time() - begun_s)))
    return await _write(proxy.tally.counts(), folder, rules)


async def _write_if_it_can(counts: Mapping[Key, Counts], folder: Path, rules: Sequence[Rule]) -> None:
    """A full disk is no reason to cut anybody off; at the end it is an error."""
    try:
        await _write(counts, folder, rules)
    except RunError as error:
        log.warning("%s; going on, and trying again", error)


async def _write(counts: Mapping[Key, Counts], folder: Path, rules: Sequence[Rule]) -> list[Row]:
    """In a thread, so that nothing waits for the disk."""

    def written() -> list[Row]:
        rows = rows_of(counts, rules)
        write_rows(folder, rows, rules)
        return rows

    return await asyncio.to_thread(written)
