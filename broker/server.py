"""The broker process: listens, watches its connections, publishes its counters, ends cleanly."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gc
import logging
import os
import signal
import socket
import threading
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jouleswarm.broker.acceptor import Acceptor
from jouleswarm.broker.access import Guard
from jouleswarm.broker.by_rule import RuleMeter
from jouleswarm.broker.core import SwarmBroker
from jouleswarm.broker.counters import SnapshotPublisher
from jouleswarm.broker.exporter import start_exporter
from jouleswarm.broker.limits import Limits
from jouleswarm.broker.lines import tell
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.rereading import read_anew
from jouleswarm.broker.tls import TlsFiles
from jouleswarm.common.allocator import keep_freed_memory
from jouleswarm.common.bus.paho_client import name_of
from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.tally import RULED
from jouleswarm.common.process import on_hangup

logger = logging.getLogger("broker")

WATCH_INTERVAL_S = 0.5
AGE_INTERVAL_S = 60.0
LEAVE_S = 10.0
# Each message makes a few objects that live until it is acknowledged; looking at them each 700 was a tenth of the time.
COLLECTED_AT = 20_000
KEEPALIVE_FACTOR = 1.5  # MQTT 3.1.1, section 3.1.2.10


@dataclass(frozen=True)
class Settings:
    """How to run a broker process. A port of 0 picks a free one; no metrics port, no exporter."""

    host: str = "127.0.0.1"
    port: int = 1883
    metrics_port: int | None = 9883
    metering: bool = True
    links: Path | None = None
    """Rules by which to count whatever passes."""
    exit_with_stdin: bool = False
    limits: Limits = field(default_factory=Limits)
    tls: TlsFiles | None = None
    state: Path | None = None
    """Folder of counters that the next broker with this folder goes on from."""


@dataclass(frozen=True)
class Addresses:
    """Where a running broker is to be found."""

    url: str
    metrics: str | None


async def run(settings: Settings, ready: Callable[[Addresses], None], guard: Guard | None = None) -> RuleMeter | None:
    """Serve until SIGTERM, SIGINT or (where asked for) the end of stdin. Without a guard everybody is let in.

    Gives what was counted by rules, where there are any.

    Raises:
        ConfigurationError: an address is in use or cannot be listened on, a file cannot be used for TLS, a rule can't
            be, or another process holds the state folder.
        RunError: the counters in that folder are not as they were written, or there is no space for more; or a part of
            the broker has failed, without which it would go on only half.
    """
    context = settings.tls.context() if settings.tls is not None else None
    keep_freed_memory(settings.limits.memory_bytes)
    gc.freeze()
    gc.set_threshold(COLLECTED_AT)
    ended = _ending(settings.exit_with_stdin)
    failures: list[RunError] = []

    def fail(error: RunError) -> None:
        failures.append(error)
        ended.set()

    async with AsyncExitStack() as stack:
        if settings.state is not None:
            stack.enter_context(Lock(settings.state, "broker"))
        meter = _meter(settings, by_user=guard is not None)
        broker = SwarmBroker(settings.limits, meter, guard)
        meter.on_failure = fail
        heard = asyncio.Event()
        if meter.by_rule is not None or guard is not None:
            on_hangup(heard.set, ended.set)
        if guard:
            stack.callback(guard.close)
        listener = stack.enter_context(_listen(settings.host, settings.port))
        metrics = None
        if settings.metrics_port is not None:
            metrics = _export(broker, settings.host, settings.metrics_port)
        await broker.start()
        stack.push_async_callback(broker.shutdown)
        publisher = SnapshotPublisher(broker)
        await publisher.announce()
        acceptor = Acceptor(listener, broker, context)
        stack.push_async_callback(acceptor.close)
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        url = f"{'mqtts' if context else 'mqtt'}://{host}:{listener.getsockname()[1]}"
        ready(Addresses(url, f"http://{host}:{metrics}/metrics" if metrics else None))
        try:
            own = watch(broker), age(broker), tell(broker), broker.chores(), read_anew(heard, broker)
            await _work(ended, publisher.run(), *own)
        except ExceptionGroup as failed:
            logger.exception("a part of the broker has failed")
            first = failed.exceptions[0]
            raise RunError(
                f"a part of the broker has failed ({type(first).__name__}: {first}), so it ends; the lines above say "
                "where; start it again, and please report this"
            ) from first
        finally:
            _leave_within(LEAVE_S)
    if failures:
        raise failures[0]
    return meter.by_rule


def _meter(settings: Settings, *, by_user: bool) -> BrokerMeter:
    if settings.links is None:
        return BrokerMeter(enabled=settings.metering, folder=settings.state)
    if not settings.metering:
        raise ConfigurationError("got --links and --no-meter; expected one of them: rules are to count by")
    folder = settings.state and settings.state / RULED
    by_rule = RuleMeter(settings.links, folder, by_user=by_user)
    return BrokerMeter(folder=settings.state, by_rule=by_rule)


async def _work(ended: asyncio.Event, *jobs: Coroutine[Any, Any, None]) -> None:
    """Run jobs that never end by themselves until `ended`; one that fails ends them all."""
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(job) for job in jobs]
        await ended.wait()
        for task in tasks:
            task.cancel()


def _leave_within(limit_s: float) -> None:
    """End the process, whatever it does, should it not have left by then."""

    def give_up() -> None:
        logger.error("the broker did not leave within %g s, and is ended", limit_s)
        logging.shutdown()  # which waits no longer than a moment for who reads it
        os._exit(RunError.exit_code)

    timer = threading.Timer(limit_s, give_up)
    timer.daemon = True  # who leaves in time does not wait for it
    timer.start()


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listener = socket.create_server((host, port), family=family, backlog=512)
    except OSError as error:
        raise ConfigurationError(_cannot_listen(host, port, error, "--port")) from error
    listener.setblocking(False)
    return listener


def _export(broker: SwarmBroker, host: str, port: int) -> int:
    try:
        # Its thread is a daemon and ends with the process; to stop it by itself takes half a second.
        return start_exporter(broker, host, port)
    except OSError as error:
        raise ConfigurationError(_cannot_listen(host, port, error, "--metrics-port")) from error


def _cannot_listen(host: str, port: int, error: OSError, option: str) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} on {host} is in use by another process; choose another with {option} (0 = any free one)"
    return f"cannot listen on {host}:{port} ({error.strerror or error}); check --host and {option}"


def _ending(exit_with_stdin: bool) -> asyncio.Event:
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, ended.set)
    # Ctrl-C reaches the whole process group; a broker that has a launcher outlives it, so that the
    # launcher can still collect the counters, and ends when the launcher lets go of its stdin.
    loop.add_signal_handler(signal.SIGINT, (lambda: None) if exit_with_stdin else ended.set)
    if exit_with_stdin:

        def wait_for_end() -> None:
            with contextlib.suppress(OSError):  # closed from the beginning: the same
                while os.read(0, 65536):
                    pass
            loop.call_soon_threadsafe(ended.set)

        threading.Thread(target=wait_for_end, name="stdin", daemon=True).start()
    return ended


async def watch(broker: SwarmBroker) -> None:
    """End connections that are silent for 1.5 keepalives, or take nothing of what is queued for them."""
    loop = asyncio.get_running_loop()
    while True:
        now_s = loop.time()
        for handler in tuple(broker.handlers):
            connection = handler.connection
            allowed_s = KEEPALIVE_FACTOR * handler.session.keep_alive
            if reason := handler.overdue(now_s):
                what = "stalled"
            elif allowed_s and connection.silent_for(now_s) > allowed_s:
                reason, what = f"it was silent for {allowed_s:g} s, 1.5 keepalives", "silent"
            else:
                continue
            broker.meter.refused(f"dropped_{what}", f"client {name_of(handler.session.client_id)} dropped: {reason}")
            logger.warning("client %s dropped: %s", handler.session.client_id, reason)
            connection.abort(reason)
        await asyncio.sleep(WATCH_INTERVAL_S)


async def age(broker: SwarmBroker) -> None:
    """Have the meter forget what was counted long ago."""
    while True:
        broker.meter.age(asyncio.get_running_loop().time())
        await asyncio.sleep(AGE_INTERVAL_S)
