"""What clients make the broker hold beside messages on their way: books that keep each within its limit."""

from __future__ import annotations

from jouleswarm.broker.limits import OVERHEAD_BYTES


class Retained:
    """Sizes of the retained messages by topic."""

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._sizes: dict[str, int] = {}
        self.held_bytes = 0

    def book(self, topic: str, payload_bytes: int) -> bool:
        """Whether a message may be retained in place of its topic's last one; an empty one clears the topic."""
        size = payload_bytes + len(topic) + OVERHEAD_BYTES if payload_bytes else 0
        before = self._sizes.pop(topic, 0)
        fits = self.held_bytes - before + size <= self._limit_bytes
        self.held_bytes += (size if fits else 0) - before
        if size and fits:
            self._sizes[topic] = size
        return fits


class Away:
    """Persistent sessions whose clients are away, those longest away first, and the bytes kept for each."""

    def __init__(self, sessions: int, session_bytes: int, all_bytes: int) -> None:
        self._sessions, self._session_bytes, self._all_bytes = sessions, session_bytes, all_bytes
        self._kept: dict[str, int] = {}
        self._total_bytes = 0

    def leaves(self, client_id: str, kept_bytes: int) -> list[str]:
        """A client went, leaving messages that it has not acknowledged; returns the sessions to give up for it."""
        self.returns(client_id)
        self._kept[client_id] = kept_bytes
        self._total_bytes += kept_bytes
        surplus = []
        while len(self._kept) > self._sessions or (self._total_bytes > self._all_bytes and len(self._kept) > 1):
            surplus.append(next(iter(self._kept)))
            self.returns(surplus[-1])
        return surplus

    def returns(self, client_id: str) -> None:
        """The client is back, or its session has ended."""
        self._total_bytes -= self._kept.pop(client_id, 0)

    def keep(self, client_id: str, size_bytes: int) -> bool:
        """Whether one more message may be kept for a client."""
        kept_bytes = self._kept.get(client_id, 0) + size_bytes
        if kept_bytes > self._session_bytes or self._total_bytes + size_bytes > self._all_bytes:
            return False
        self._kept[client_id] = kept_bytes
        self._total_bytes += size_bytes
        return True
