"""A TCP proxy before the broker that can spoil connections: cut them in the middle of a message, or slow them down."""

from __future__ import annotations

import asyncio
import contextlib
import random
import threading
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Self
from urllib.parse import urlsplit

from jouleswarm.common.errors import RunError

_START_S = 10.0
_CHUNK_BYTES = 65_536
_PAST_MARK_BYTES = 200  # into the payload of whatever message carries the mark in its topic


@dataclass
class Slowness:
    """A bad link: bytes a second for each direction of each connection, and the odds that a chunk is its last."""

    bytes_per_s: float
    cut_odds: float


class Proxy:
    """Context manager: a thread that passes connections on to the broker at `url`."""

    def __init__(self, url: str, seed: int = 0) -> None:
        broker = urlsplit(url)
        assert broker.hostname is not None
        assert broker.port is not None
        self._host, self._port = broker.hostname, broker.port
        self._random = random.Random(seed)
        self._mark: bytes | None = None
        self._slowness: Slowness | None = None
        self._listening: Future[str] = Future()
        self._loop = asyncio.new_event_loop()
        self._ended: asyncio.Event | None = None
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._serve(),), daemon=True)
        self.url, self.cuts = "", 0

    def __enter__(self) -> Self:
        self._thread.start()
        try:
            self.url = self._listening.result(_START_S)
        except (OSError, TimeoutError) as error:
            raise RunError(
                f"the proxy before the broker cannot listen: {error or f'not within {_START_S:g} s'}"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        assert self._ended is not None
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()
        self._loop.close()

    def cut_at(self, mark: bytes) -> None:
        """Cut the next connection that carries `mark`, a little way behind it."""
        self._mark = mark

    @property
    def is_armed(self) -> bool:
        """Whether a cut that was asked for has not been made yet."""
        return self._mark is not None

    def slow_down(self, slowness: Slowness | None) -> None:
        """Make all connections bad, or good again."""
        self._slowness = slowness

    async def _serve(self) -> None:
        self._ended = asyncio.Event()
        try:
            server = await asyncio.start_server(self._pass_on, "127.0.0.1", 0)
        except OSError as error:
            self._listening.set_exception(error)
            return
        self._listening.set_result(f"mqtt://127.0.0.1:{server.sockets[0].getsockname()[1]}")
        await self._ended.wait()
        server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            there, back = await asyncio.open_connection(self._host, self._port)
        except OSError:  # the broker is down: so is the line to it
            writer.transport.abort()
            return
        pumps = [asyncio.create_task(self._pump(*ends)) for ends in ((reader, back), (there, writer))]
        try:
            with contextlib.suppress(asyncio.CancelledError):  # the proxy ends
                await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for pump in pumps:
                pump.cancel()
            for end in (writer, back):
                end.transport.abort()
            await asyncio.gather(*pumps, return_exceptions=True)

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while chunk := await reader.read(_CHUNK_BYTES):
                passed = self._cut(chunk)
                writer.write(passed)
                await writer.drain()
                if len(passed) < len(chunk):
                    self.cuts += 1
                    return
                if self._slowness is not None:
                    await asyncio.sleep(len(chunk) / self._slowness.bytes_per_s)

    def _cut(self, chunk: bytes) -> bytes:
        mark, slowness = self._mark, self._slowness
        if mark is not None and (at := chunk.find(mark)) >= 0 and at + _PAST_MARK_BYTES < len(chunk):
            self._mark = None
            return chunk[: at + _PAST_MARK_BYTES]
        if slowness is not None and self._random.random() < slowness.cut_odds:
            return chunk[: len(chunk) // 2]
        return chunk
