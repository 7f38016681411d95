"""Packets to one socket: written in slices, sharing their payloads with the other subscribers' queues."""

from __future__ import annotations

import asyncio
import fcntl
import socket
import struct
import termios
from collections import deque
from collections.abc import Callable
from itertools import islice

from jouleswarm.broker.limits import REPLIES, Turns

GATHERED = 256  # packets in one system call
AT_ONCE_BYTES = 64 * 1024  # a packet as large does not wait for others to go with it

Done = Callable[[int], None]


class _Outgoing:
    """A packet that is being written: header, then payload."""

    __slots__ = ("done", "header", "is_reply", "payload", "sent", "size")

    def __init__(self, header: bytes, payload: memoryview | None, done: Done | None, is_reply: bool) -> None:
        self.header = header
        self.payload = payload
        self.done = done
        self.is_reply = is_reply
        self.size = len(header) + (len(payload) if payload is not None else 0)
        self.sent = 0

    def views(self, room: int) -> list[bytes | memoryview]:
        """What is left to write, `room` bytes of the payload at most."""
        start, head = self.sent, len(self.header)
        views: list[bytes | memoryview] = []
        if start < head:
            views.append(self.header[start:] if start else self.header)
            start = head
        if self.payload is not None and start < self.size:
            views.append(self.payload[start - head : start - head + room])
        return views


class PacketWriter:
    """A queue of packets in front of a non-blocking socket."""

    def __init__(self, sock: socket.socket, turns: Turns, fail: Callable[[str], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._sock, self._fd = sock, sock.fileno()
        self._turns, self._fail = turns, fail
        self._queue: deque[_Outgoing] = deque()
        self._writing = self._closing = self._due = False
        self._ended = False
        self._written = self._taken = 0
        self._last_taken_s = self._loop.time()
        self.replies = 0
        self.queued_bytes = 0
        self.on_control: Callable[[int], None] | None = None
        """Told of the bytes of each packet without a `done` of its own that was written whole."""
        self._caught_up: asyncio.Future[None] | None = None

    def send(
        self, header: bytes, payload: memoryview | None = None, done: Done | None = None, *, retained: bool = False
    ) -> None:
        """Queue a packet. `done` is called once, with the bytes of it that were written.

        That is the packet's size when it was completely written and less when the connection ended first.
        """
        if self._ended:
            if done is not None:
                done(0)
            return
        if not self._queue:
            self._last_taken_s = self._loop.time()
        item = _Outgoing(header, payload, done, retained or payload is None)
        self._queue.append(item)
        self.replies += item.is_reply
        self.queued_bytes += item.size
        if self._writing:
            return
        if item.size >= AT_ONCE_BYTES:
            self._flush()
        elif not self._due:
            self._due = True
            self._loop.call_soon(self._flush_due)

    async def caught_up(self) -> None:
        """Wait while the peer leaves unread too much of what it asked for itself: acknowledgements, retained messages.

        Nothing that others publish counts, so that who waits here waits for nobody but itself.
        """
        while self.replies > REPLIES and not self._ended:
            self._caught_up = self._loop.create_future()
            await self._caught_up

    def close_when_empty(self) -> None:
        """End the connection when all that is queued has been written."""
        self._closing = True
        if not self._queue:
            self._fail("closed by the broker")

    def overdue(self, now_s: float, stall_s: float) -> str | None:
        """Why the connection must be ended for taking nothing of what is queued, if it must."""
        if not self._queue:
            return None
        taken = self._written - self._unacknowledged()
        if taken > self._taken:
            self._taken, self._last_taken_s = taken, now_s
        if now_s - self._last_taken_s > stall_s:
            return f"it read nothing for {stall_s:g} s while {len(self._queue)} packets waited for it"
        return None

    def end(self) -> None:
        """Nothing more will be written; what the socket does not take now is given up."""
        self._flush_due()
        self._ended = True
        self._stop_writing()
        queue, self._queue = self._queue, deque()
        self.replies = self.queued_bytes = 0
        self._wake()
        for item in queue:
            if item.done is not None:
                item.done(item.sent)

    def _flush_due(self) -> None:
        if self._due and not self._ended:
            self._due = False
            if self._queue and not self._writing:
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
            self._fail(f"writing failed: {error.strerror}")
            return
        self._written += count
        self._complete(count)
        if self._queue and not self._writing:
            self._writing = True
            self._turns.writers += 1
            self._loop.add_writer(self._fd, self._flush)
        elif not self._queue:
            self._stop_writing()
            if self._closing:
                self._fail("closed by the broker")

    def _complete(self, count: int) -> None:
        while count:
            item = self._queue[0]
            left = item.size - item.sent
            if count < left:
                item.sent += count
                return
            count -= left
            self._queue.popleft()
            self.queued_bytes -= item.size
            if item.is_reply:
                self.replies -= 1
                if self.replies <= REPLIES:
                    self._wake()
            if item.done is not None:
                item.done(item.size)
            elif self.on_control is not None:
                self.on_control(item.size)

    def _wake(self) -> None:
        if self._caught_up is not None and not self._caught_up.done():
            self._caught_up.set_result(None)

    def _stop_writing(self) -> None:
        if self._writing:
            self._loop.remove_writer(self._fd)
            self._writing = False
            self._turns.writers -= 1

    def _unacknowledged(self) -> int:
        # A slow reader frees the kernel's send buffer long before the socket becomes writable again, so
        # progress is what the peer's TCP acknowledged, not what could be written.
        answer = fcntl.ioctl(self._fd, termios.TIOCOUTQ, struct.pack("i", 0))
        count: int = struct.unpack("i", answer)[0]
        return count
