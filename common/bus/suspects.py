"""Which message ends the connection each time: a broker that takes no message of its size closes without a word."""

from __future__ import annotations

from dataclasses import dataclass

CONNECTIONS = 5
SOON_S = 5.0

Key = int | str
"""A message: by its packet identifier, by its topic at QoS 0."""


@dataclass
class Suspect:
    """A PUBLISH packet that was begun on this connection and of which nothing shows that the broker took it."""

    topic: str
    packet_bytes: int
    written_s: float | None = None


class Suspects:
    """Messages under way on one connection after the other.

    The same one under way at the end of CONNECTIONS connections in a row, each accepted by the broker and closed by it,
    is not taken. A broker that is killed or a line that is cut does not trip this: what comes through on any of
    those connections begins anew. At QoS 0 nothing is acknowledged, and only a message just sent is suspected.
    """

    def __init__(self) -> None:
        self._open: dict[Key, Suspect] = {}
        self._times: dict[Key, int] = {}

    def begun(self, key: Key, topic: str, packet_bytes: int) -> None:
        """The first bytes of a message were written."""
        self._open.setdefault(key, Suspect(topic, packet_bytes))

    def written(self, key: Key, now_s: float) -> None:
        """The last ones were."""
        if key in self._open and self._open[key].written_s is None:
            self._open[key].written_s = now_s

    def confirmed(self, packet_id: int) -> None:
        """A message was acknowledged, so that those at QoS 0 before it were read too."""
        while self._open and isinstance(key := next(iter(self._open)), str):
            self._forget(key)
        self._forget(packet_id)

    def lost(self, now_s: float) -> Suspect | None:
        """The broker closed the connection; the message that it takes by no means, if there is one."""
        under_way, self._open = self._open, {}
        self._times = {
            key: self._times.get(key, 0) + 1
            for key, suspect in under_way.items()
            if isinstance(key, int) or suspect.written_s is None or now_s - suspect.written_s < SOON_S
        }
        refused = [under_way[key] for key, times in self._times.items() if times >= CONNECTIONS]
        return max(refused, key=lambda suspect: suspect.packet_bytes, default=None)

    def connecting(self) -> None:
        """A new connection is made; the last one, if messages were under way on it, has ended in another way."""
        if self._open:
            self._open, self._times = {}, {}

    def _forget(self, key: Key) -> None:
        self._open.pop(key, None)
        self._times.pop(key, None)
