"""What the broker allows its clients, and how the broker holds memory down."""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass

MEGABYTE = 1024 * 1024

# What a queued message costs beside its payload, and once more for each receiver: Python objects, queue entries.
OVERHEAD_BYTES = 512
# What no client needs more of: a SUBSCRIBE to four thousand filters, answers that wait for a client to read them.
CONTROL_BYTES = 256 * 1024
REPLIES = 1000


@dataclass(frozen=True)
class Limits:
    """Limits of the broker; sizes in bytes, times in seconds."""

    message_bytes: int = 64 * MEGABYTE
    memory_bytes: int = 192 * MEGABYTE
    offline_bytes: int = 64 * MEGABYTE  # for one persistent session that is away
    all_offline_bytes: int = 256 * MEGABYTE
    offline_sessions: int = 1000
    retained_bytes: int = 64 * MEGABYTE
    subscriptions: int = 5000  # of one client
    name_length: int = 1024  # of a topic, a topic filter or a client id, characters
    connections: int = 1000
    connect_timeout_s: float = 10.0
    stall_timeout_s: float = 60.0
    pressed_stall_timeout_s: float = 10.0  # of who holds more than its share while publishers wait for room
    session_expiry_s: int = 3600


class Turns:
    """How much a connection writes before the event loop goes on to the next one.

    Many subscribers of one large message write it in small slices, so that all of them take the same part of
    it while it is in the processor's cache. A single one writes as much as its socket takes.
    """

    ALL_BYTES = 4 * MEGABYTE
    LEAST_BYTES = 256 * 1024

    def __init__(self) -> None:
        self.writers = 0

    @property
    def slice_bytes(self) -> int:
        """Bytes for one turn, by the number of connections that wait to write."""
        return max(self.LEAST_BYTES, self.ALL_BYTES // max(1, self.writers))


class Budget:
    """Bytes of messages held in memory. Readers wait here, first come first served, for room.

    One message is always let in when nothing else is held, however large: a budget below the
    largest message must slow publishers down, never stop them for ever.
    """

    def __init__(self, limit_bytes: int) -> None:
        self.limit_bytes = limit_bytes
        self.used_bytes = 0
        self._waiters: deque[tuple[int, asyncio.Future[None]]] = deque()

    @property
    def is_pressed(self) -> bool:
        """Whether somebody waits for room."""
        return any(not granted.done() for _, granted in self._waiters)

    def try_take(self, size_bytes: int) -> bool:
        """Take room if there is some and nobody waits for it."""
        if self._waiters or not self._fits(size_bytes):
            return False
        self.used_bytes += size_bytes
        return True

    def request(self, size_bytes: int) -> asyncio.Future[None]:
        """A future that is done when the room has been taken. One that fails before that takes nothing."""
        granted: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiters.append((size_bytes, granted))
        return granted

    def charge(self, size_bytes: int) -> None:
        """Take room without waiting, for what must not wait."""
        self.used_bytes += size_bytes

    def release(self, size_bytes: int) -> None:
        """Give room back and let in those that wait for it."""
        self.used_bytes -= size_bytes
        while self._waiters:
            size_bytes, granted = self._waiters[0]
            if granted.done():
                self._waiters.popleft()
            elif self._fits(size_bytes):
                self._waiters.popleft()
                self.used_bytes += size_bytes
                granted.set_result(None)
            else:
                return

    def _fits(self, size_bytes: int) -> bool:
        return self.used_bytes == 0 or self.used_bytes + size_bytes <= self.limit_bytes
