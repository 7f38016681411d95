"""Packets from one socket, each read straight into a buffer of its own size."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable

import numpy as np
from amqtt.mqtt.packet import PUBLISH

from jouleswarm.broker.errors import MalformedPacket, MessageTooLarge, PeerGone
from jouleswarm.broker.limits import CONTROL_BYTES, OVERHEAD_BYTES, Budget, Limits
from jouleswarm.broker.packets import Packet

BUFFER_BYTES = 16 * 1024
# What one client's large packets may take without a look at the others.
TURN_BYTES = 1024 * 1024
TOPIC_WAIT_S = 0.5


class PacketReader:
    """Reads only while somebody waits for a packet, and a PUBLISH only when the budget has room for it."""

    def __init__(self, sock: socket.socket, limits: Limits, budget: Budget, fail: Callable[[str], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self.last_received_s = self._loop.time()
        self._sock, self._fd = sock, sock.fileno()
        self._limits, self._budget, self._fail = limits, budget, fail
        self._buffer = memoryview(bytearray(BUFFER_BYTES))
        self._start = self._end = 0
        self._targets, self._wanted, self._got = [self._buffer], 0, 0
        self._has_more, self._turn_bytes = False, 0
        self._waiter: asyncio.Future[None] | None = None
        self._room: asyncio.Future[None] | None = None
        self._reading = self._in_packet = False
        self.held_bytes = 0  # of the budget, for the packet that is coming in
        self._ended: str | None = None

    @property
    def waits_for_room(self) -> bool:
        """Whether the broker itself has stopped reading from this client for want of memory."""
        return self._room is not None

    async def begun(self) -> None:
        """Wait until a packet has begun to come. Raises PeerGone."""
        if self._end - self._start < 2:
            await self._fill(2)

    def ready_packet(self) -> Packet | None:
        """The next packet if it has come whole already and there is room for it; None: `read_packet` tells more."""
        buffer, start, end = self._buffer, self._start, self._end
        if end - start < 2:
            return None
        first, length = buffer[start], buffer[start + 1]
        start += 2
        if length >= 128:
            if start == end or buffer[start] >= 128:
                return None
            length += (buffer[start] - 1) << 7
            start += 1
        if start + length > end:
            return None
        cost_bytes = 0
        if first >> 4 == PUBLISH:
            cost_bytes = length + OVERHEAD_BYTES
            if length > self._limits.message_bytes or not self._budget.try_take(cost_bytes):
                return None
        self._start = start + length
        return Packet(first, memoryview(bytes(buffer[start : self._start])), cost_bytes)

    async def read_packet(self, limit_bytes: int | None = None) -> Packet:
        """The next packet.

        Raises:
            PeerGone: the connection has ended.
            MalformedPacket: remaining length of more than four bytes (MQTT 3.1.1, section 2.2.3).
            MessageTooLarge: over the size limit.
        """
        first, length = await self._fixed_header()
        limit_bytes = limit_bytes or (self._limits.message_bytes if first >> 4 == PUBLISH else CONTROL_BYTES)
        if length > limit_bytes:
            what = f"PUBLISH{await self._topic()}" if first >> 4 == PUBLISH else f"packet 0x{first:02x}"
            raise MessageTooLarge(f"{what} of {length} bytes, the limit here is {limit_bytes}")
        cost_bytes = 0
        if first >> 4 == PUBLISH:
            cost_bytes = length + OVERHEAD_BYTES
            await self._take(cost_bytes)
            self.held_bytes = cost_bytes
        try:
            body = await self._read_body(length)
        except BaseException:
            self._budget.release(cost_bytes)
            raise
        finally:
            self.held_bytes = 0
        self._in_packet = False
        return Packet(first, body, cost_bytes)

    def overdue(self, now_s: float, stall_s: float) -> str | None:
        """Why the connection must be ended for stopping in mid-packet, if it must."""
        if self._in_packet and not self.waits_for_room and now_s - self.last_received_s > stall_s:
            return f"it stopped in the middle of a packet for {stall_s:g} s"
        return None

    def end(self, reason: str) -> None:
        """Nothing more will be read; who waits for a packet gets PeerGone."""
        self._ended = reason
        self._loop.remove_reader(self._fd)
        for waiter in (self._waiter, self._room):
            if waiter is not None and not waiter.done():
                waiter.set_exception(PeerGone(reason))

    async def _fixed_header(self) -> tuple[int, int]:
        await self._fill(2)
        self._in_packet = True
        first, length, digits = self._buffer[self._start], 0, 0
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
        return first, length

    async def _topic(self) -> str:
        """The topic of a PUBLISH that is not taken, as far as it has come: for who looks for the reason."""
        with contextlib.suppress(TimeoutError, PeerGone):
            async with asyncio.timeout(TOPIC_WAIT_S):
                await self._fill(2)
                end = 2 + int.from_bytes(self._buffer[self._start : self._start + 2], "big")
                if end <= BUFFER_BYTES:
                    await self._fill(end)
                    return f" on {bytes(self._buffer[self._start + 2 : self._start + end]).decode(errors='replace')!r}"
        return ""

    async def _take(self, cost_bytes: int) -> None:
        if self._budget.try_take(cost_bytes):
            return
        self._room = self._budget.request(cost_bytes)
        try:
            await self._room
        finally:
            self._room = None
            self.last_received_s = self._loop.time()

    async def _read_body(self, length: int) -> memoryview:
        # Unlike a bytearray, not filled with zeros first: a tenth of a large message's time here.
        body = np.empty(length, np.uint8).data
        ready = min(length, self._end - self._start)
        body[:ready] = self._buffer[self._start : self._start + ready]
        self._start += ready
        if ready < length:
            # What follows the packet comes in the same call, if it is there.
            self._start = self._end = 0
            self._end = await self._receive([body[ready:], self._buffer], length - ready) - (length - ready)
        return body

    async def _fill(self, count: int) -> None:
        while self._end - self._start < count:
            rest = self._end - self._start
            self._buffer[:rest] = bytes(self._buffer[self._start : self._end])
            self._start, self._end = 0, rest
            self._end += await self._receive([self._buffer[rest:]], 1)

    async def _receive(self, targets: list[memoryview], wanted: int) -> int:
        self._targets, self._wanted, self._got = targets, wanted, 0
        if self._has_more and wanted > 1:  # the rest of a packet: small ones take turns by the buffer
            self._take_in()
        if self._ended is not None:
            raise PeerGone(self._ended)
        if self._got >= wanted:
            return self._got
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
        self._turn_bytes = 0
        self._take_in()
        if self._got >= self._wanted and not self._waiter.done():
            self._waiter.set_result(None)

    def _take_in(self) -> None:
        """Read once. What fills all of its place may have left more in the socket."""
        try:
            count = self._read(self._targets)
        except (BlockingIOError, InterruptedError):
            self._has_more = False
            return
        except OSError as error:
            self._fail(f"reading failed: {error.strerror}")
            return
        if count == 0:
            self._fail("the client closed the connection")
            return
        self.last_received_s = self._loop.time()
        self._got += count
        self._turn_bytes += count
        self._has_more = count == sum(map(len, self._targets)) and self._turn_bytes < TURN_BYTES
        if self._got < self._wanted:
            self._targets[0] = self._targets[0][count:]

    def _read(self, targets: list[memoryview]) -> int:
        return self._sock.recvmsg_into(targets)[0]
