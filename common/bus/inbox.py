"""Messages that have come and that nobody has read yet, held down to a budget of bytes."""

from __future__ import annotations

from collections import deque

from jouleswarm.common.bus.bus import Message

BUDGET_BYTES = 128 * 1024 * 1024
GROWS_FOR_S = 300.0
_OVERHEAD_BYTES = 512  # of Python objects, for each message


class Inbox:
    """A queue with a budget. Whoever fills it asks for room before each message, so that one may go beyond it.

    While nobody reads, the budget grows, to its double in GROWS_FOR_S and no further: a broker drops a client that
    takes nothing at all, and its user may compute for minutes.
    """

    def __init__(self) -> None:
        self._messages: deque[Message] = deque()
        self._bytes = 0
        self._full_since_s: float | None = None

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: Message) -> None:
        """Add a message."""
        self._messages.append(message)
        self._bytes += _size(message)

    def take(self) -> Message:
        """The oldest message."""
        message = self._messages.popleft()
        self._bytes -= _size(message)
        self._full_since_s = None
        return message

    def has_room(self, now_s: float) -> bool:
        """Whether one more message may come."""
        if self._bytes < BUDGET_BYTES:
            return True
        if self._full_since_s is None:
            self._full_since_s = now_s
        growth = min(1.0, (now_s - self._full_since_s) / GROWS_FOR_S)
        return self._bytes < BUDGET_BYTES * (1 + growth)


def _size(message: Message) -> int:
    return len(message.topic) + len(message.payload) + _OVERHEAD_BYTES
