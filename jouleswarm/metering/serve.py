"""A meter from its start to its end: what `jouleswarm meter proxy` and `meter serve` do."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from collections.abc import Callable
from urllib.parse import urlsplit

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.process import on_hangup
from jouleswarm.metering.proxy import Proxy
from jouleswarm.metering.recorder import Recorder

_SWITCH_S = 0.0005  # not Python's 5 ms: so long the connections wait for who writes, after each of their calls


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
) -> None:
    """Have a proxy meter until a signal to end.

    Raises:
        ConfigurationError: it can't listen.
        RunError: it can't write.
    """
    sys.setswitchinterval(_SWITCH_S)
    stop = ending(recorder.read_rules)
    async with proxy.listening(*listen) as port:
        on_listening(port)
        await recorder.record(stop)
    await recorder.end()
