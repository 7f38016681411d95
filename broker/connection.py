"""One client's TCP connection: packets in without copies, packets out in slices that share their payload."""

from __future__ import annotations

import asyncio
import fcntl
import logging
import socket
import struct
import termios
from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import NamedTuple

from amqtt.adapters import WriterAdapter
from amqtt.mqtt.packet import PUBLISH

from broker.limits import OVERHEAD_BYTES, Budget, Limits, Turns

logger = logging.getLogger("broker")

BUFFER_BYTES = 16 * 1024
SOCKET_BUFFER_BYTES = 4 * 1024 * 1024
GATHERED = 64  # packets in one system call


class PeerGone(ConnectionError):
    """The connection has ended; its text says why."""


class MalformedPacket(Exception):
    """A packet that MQTT 3.1.1 does not allow. It costs its sender the connection, nobody else anything."""

    event = "refused_malformed"


class MessageTooLarge(MalformedPacket):
    """A packet over the size limit, known from its fixed header, before anything is allocated."""

    event = "refused_too_large"


class Packet(NamedTuple):
    """A packet as received: first byte, everything after the fixed header, and what it took of the budget."""

    first: int
    body: bytearray
    cost_bytes: int


class _Outgoing:
    """A packet that is being written: header, then payload."""

    __slots__ = ("done", "header", "payload", "sent", "size")

    def __init__(self, header: bytes, payload: memoryview | None, done: Callable[[int], None] | None) -> None:
        self.header = header
        self.payload = payload
        self.done = done
        self.size = len(header) + (len(payload) if payload is not None else 0)
        self.sent = 0

    def views(self, room: int) -> list[bytes | memoryview]:
        start, head = self.sent, len(self.header)
        views: list[bytes | memoryview] = []
        if start < head:
            views.append(self.header[start:] if start else self.header)
            room -= head - start
            start = head
        if self.payload is not None and room > 0 and start < self.size:
            views.append(self.payload[start - head : start - head + room])
        return views


class Connection(WriterAdapter):  # type: ignore[misc]
    """A non-blocking socket on the running event loop. amqtt writes its control packets through it too."""

    def __init__(self, sock: socket.socket, limits: Limits, budget: Budget, turns: Turns) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER_BYTES)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BUFFER_BYTES)
        self.peer: tuple[str, int] = sock.getpeername()[:2]
        self.closed_because: str | None = None
        self.last_received_s = self.last_taken_s = asyncio.get_running_loop().time()
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._fd = sock.fileno()
        self._limits, self._budget, self._turns = limits, budget, turns
        self._buffer = memoryview(bytearray(BUFFER_BYTES))
        self._start = self._end = 0
        self._target, self._wanted, self._got = self._buffer, 0, 0
        self._waiter: asyncio.Future[None] | None = None
        self._room: asyncio.Future[None] | None = None
        self._reading = self._writing = self._closing = False
        self._in_packet = False
        self._queue: deque[_Outgoing] = deque()
        self._written = self._taken = 0

    # Reading

    async def read_packet(self, limit_bytes: int | None = None) -> Packet:
        """The next packet.

        Raises:
            PeerGone: the connection has ended.
            MalformedPacket: remaining length of more than four bytes (MQTT 3.1.1, section 2.2.3).
            MessageTooLarge: over the size limit.
        """
        await self._fill(2)
        self._in_packet = True
        first = self._buffer[self._start]
        length, digits = 0, 0
        while True:
            await self._fill(digits + 2)
            digit = self._buffer[self._start + 1 + digits]
            length |= (digit & 127) << 7 * digits
            digits += 1
            if digit < 128:
                break
            if digits == 4:
                raise MalformedPacket("remaining length of more than four bytes")
        self._start += 1 + digits
        limit_bytes = limit_bytes or self._limits.message_bytes
        if length > limit_bytes:
            raise MessageTooLarge(f"packet of {length} bytes, the limit here is {limit_bytes}")
        cost_bytes = 0
        if first >> 4 == PUBLISH:
            cost_bytes = length + OVERHEAD_BYTES
            await self._take(cost_bytes)
        try:
            body = await self._read_body(length)
        except BaseException:
            self._budget.release(cost_bytes)
            raise
        self._in_packet = False
        return Packet(first, body, cost_bytes)

    async def _take(self, cost_bytes: int) -> None:
        if self._budget.try_take(cost_bytes):
            return
        self._room = self._budget.request(cost_bytes)
        try:
            await self._room
        finally:
            self._room = None
            self.last_received_s = self._loop.time()

    async def _read_body(self, length: int) -> bytearray:
        body = bytearray(length)
        ready = min(length, self._end - self._start)
        body[:ready] = self._buffer[self._start : self._start + ready]
        self._start += ready
        if ready < length:
            await self._receive(memoryview(body)[ready:], length - ready)
        return body

    async def _fill(self, count: int) -> None:
        while self._end - self._start < count:
            rest = self._end - self._start
            self._buffer[:rest] = bytes(self._buffer[self._start : self._end])
            self._start, self._end = 0, rest
            self._end += await self._receive(self._buffer[rest:], 1)

    async def _receive(self, target: memoryview, wanted: int) -> int:
        if self.closed_because is not None:
            raise PeerGone(self.closed_because)
        self._target, self._wanted, self._got = target, wanted, 0
        self._waiter = self._loop.create_future()
        if not self._reading:
            self._loop.add_reader(self._fd, self._on_readable)
            self._reading = True
        try:
            await self._waiter
        finally:
            self._waiter = None
        return self._got

    def _on_readable(self) -> None:
        if self._waiter is None or self._waiter.done():
            self._loop.remove_reader(self._fd)
            self._reading = False
            return
        try:
            count = self._sock.recv_into(self._target[self._got :])
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self.abort(f"reading failed: {error.strerror}")
            return
        if count == 0:
            self.abort("the client closed the connection")
            return
        self.last_received_s = self._loop.time()
        self._got += count
        if self._got >= self._wanted:
            self._waiter.set_result(None)

    # Writing

    def send(self, header: bytes, payload: memoryview | None = None, done: Callable[[int], None] | None = None) -> None:
        """Queue a packet. `done` is called once, with the bytes of it that were written.

        That is the packet's size when it was completely written and less when the connection ended first.
        """
        item = _Outgoing(header, payload, done)
        if self.closed_because is not None:
            if done is not None:
                done(0)
            return
        if not self._queue:
            self.last_taken_s = self._loop.time()
        self._queue.append(item)
        if not self._writing:
            self._flush()

    def _flush(self) -> None:
        views: list[bytes | memoryview] = []
        room = self._turns.slice_bytes
        for item in islice(self._queue, GATHERED):
            views += item.views(room)
            room -= item.size - item.sent
            if room <= 0:
                break
        try:
            count = self._sock.sendmsg(views)
        except (BlockingIOError, InterruptedError):
            count = 0
        except OSError as error:
            self.abort(f"writing failed: {error.strerror}")
            return
        self._written += count
        self._complete(count)
        if self._queue and not self._writing:
            self._writing = True
            self._turns.writers += 1
            self._loop.add_writer(self._fd, self._flush)
        elif not self._queue:
            self._on_empty()

    def _complete(self, count: int) -> None:
        while count:
            item = self._queue[0]
            left = item.size - item.sent
            if count < left:
                item.sent += count
                return
            count -= left
            self._queue.popleft()
            if item.done is not None:
                item.done(item.size)

    def _on_empty(self) -> None:
        self._stop_writing()
        if self._closing:
            self.abort("closed by the broker")

    def _stop_writing(self) -> None:
        if self._writing:
            self._loop.remove_writer(self._fd)
            self._writing = False
            self._turns.writers -= 1

    # Watching

    @property
    def waits_for_room(self) -> bool:
        """Whether the broker itself has stopped reading from this client for want of memory."""
        return self._room is not None

    def overdue(self, now_s: float) -> str | None:
        """Why this connection must be ended for making no progress, if it must."""
        if self.closed_because is not None:
            return None
        stall_s = self._limits.stall_timeout_s
        if self._in_packet and not self.waits_for_room and now_s - self.last_received_s > stall_s:
            return f"it stopped in the middle of a packet for {stall_s:g} s"
        if not self._queue:
            return None
        taken = self._written - self._unacknowledged()
        if taken > self._taken:
            self._taken, self.last_taken_s = taken, now_s
        if now_s - self.last_taken_s > stall_s:
            return f"it read nothing for {stall_s:g} s while {len(self._queue)} packets waited for it"
        return None

    def _unacknowledged(self) -> int:
        # A slow reader frees the kernel's send buffer long before the socket becomes writable again, so
        # progress is what the peer's TCP acknowledged, not what could be written.
        answer = fcntl.ioctl(self._fd, termios.TIOCOUTQ, struct.pack("i", 0))
        count: int = struct.unpack("i", answer)[0]
        return count

    # Ending

    def abort(self, reason: str) -> None:
        """End the connection at once; what was not written is given up."""
        if self.closed_because is not None:
            return
        self.closed_because = reason
        self._loop.remove_reader(self._fd)
        self._stop_writing()
        self._sock.close()
        for waiter in (self._waiter, self._room):
            if waiter is not None and not waiter.done():
                waiter.set_exception(PeerGone(reason))
        queue, self._queue = self._queue, deque()
        for item in queue:
            if item.done is not None:
                item.done(item.sent)

    # amqtt's writer interface

    def write(self, data: bytes) -> None:
        self.send(data)

    async def drain(self) -> None:
        """Control packets never wait for the peer."""

    def get_peer_info(self) -> tuple[str, int]:
        return self.peer

    def get_ssl_info(self) -> None:
        return None

    async def close(self) -> None:
        """End the connection when all that is queued has been written."""
        self._closing = True
        if not self._queue:
            self.abort("closed by the broker")
