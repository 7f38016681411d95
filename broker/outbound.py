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
from typing import Protocol

from jouleswarm.broker.limits import REPLIES, Turns

GATHERED = 256  # packets in one system call
AT_ONCE_BYTES = 64 * 1024  # a packet as large does not wait for others to go with it


class Outcome(Protocol):
    """Told what becomes of a packet."""

    def going(self) -> None:
        """All that is left of it goes into the kernel now: its receiver may have it before anything else is told."""

    def stayed(self) -> None:
        """The kernel did not take all of it, and there will be another `going`, or its end."""

    def ended(self, written: int) -> None:
        """Once: so many of its bytes were written, all of them unless the connection ended first."""


class _Outgoing:
    """A packet that is being written: header, then payload."""

    __slots__ = ("header", "is_reply", "outcome", "payload", "sent", "size")

    def __init__(self, header: bytes, payload: memoryview | None, outcome: Outcome | None, is_reply: bool) -> None:
        self.header = header
        self.payload = payload
        self.outcome = outcome
        self.is_reply = is_reply
        self.size = len(header) + (len(payload) if payload is not None else 0)
        self.sent = 0

    def ends_within(self, room: int) -> bool:
        """Whether `views(room)` are all that is left."""
        return self.size - max(self.sent, len(self.header)) <= room

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
        """Told of the bytes of each packet without an `outcome` of its own that was written whole."""
        self._caught_up: asyncio.Future[None] | None = None

    def send(
        self,
        header: bytes,
        payload: memoryview | None = None,
        outcome: Outcome | None = None,
        *,
        retained: bool = False,
    ) -> None:
        """Queue a packet; `outcome` is told what becomes of it."""
        if self._ended:
            if outcome is not None:
                outcome.ended(0)
            return
        if not self._queue:
            self._last_taken_s = self._loop.time()
        item = _Outgoing(header, payload, outcome, retained or payload is None)
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
            if item.outcome is not None:
                item.outcome.ended(item.sent)

    def _flush_due(self) -> None:
        if self._due and not self._ended:
            self._due = False
            if self._queue and not self._writing:
                self._flush()

    def _flush(self) -> None:
        views: list[bytes | memoryview] = []
        going: list[_Outgoing] = []
        room = self._turns.slice_bytes
        for item in islice(self._queue, GATHERED):
            views += item.views(room)
            if item.outcome is not None and item.ends_within(room):
                item.outcome.going()
                going.append(item)
            room -= item.size - item.sent
            if room <= 0:
                break
        count, error = self._write(views)
        self._complete(count)
        for item in going:
            if item.outcome is not None and item.sent < item.size:
                item.outcome.stayed()
        if error is not None:
            self._fail(f"writing failed: {error.strerror}")
        elif self._queue and not self._writing:
            self._writing = True
            self._turns.writers += 1
            self._loop.add_writer(self._fd, self._flush)
        elif not self._queue:
            self._stop_writing()
            if self._closing:
                self._fail("closed by the broker")

    def _write(self, views: list[bytes | memoryview]) -> tuple[int, OSError | None]:
        """The bytes that the kernel took, and what failed."""
        try:
            count = self._sock.sendmsg(views)
        except (BlockingIOError, InterruptedError):
            return 0, None
        except OSError as error:
            return 0, error
        self._written += count
        return count, None

    def _complete(self, count: int) -> None:
        while count:
            item = self._queue[0]
            left = item.size - item.sent
            if count < left:
                item.sent += count
                return
            count -= left
            item.sent = item.size
            self._queue.popleft()
            self.queued_bytes -= item.size
            if item.is_reply:
                self.replies -= 1
                if self.replies <= REPLIES:
                    self._wake()
            if item.outcome is not None:
                item.outcome.ended(item.size)
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
