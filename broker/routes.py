"""Who receives what is published on a topic."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from amqtt.session import Session

CACHED_TOPICS = 20_000

Receivers = list[tuple[Session, int]]


class Routes:
    """Receivers by topic, found once by going through all filters and kept until any subscription changes."""

    def __init__(
        self,
        subscriptions: Mapping[str, Sequence[tuple[Session, int]]],
        matches: Callable[[str, str], bool],
        may_receive: Callable[[Session, str], bool],
    ) -> None:
        self._subscriptions = subscriptions
        self._matches = matches
        self._may_receive = may_receive
        self._known: dict[str, Receivers] = {}

    def forget(self) -> None:
        """A subscription or a session has changed."""
        self._known = {}

    def receivers(self, topic: str) -> Receivers:
        """Sessions with a matching subscription, each once, with the highest QoS granted."""
        known = self._known
        if (receivers := known.get(topic)) is not None:
            return receivers
        found: dict[str, tuple[Session, int]] = {}
        for topic_filter, subscriptions in self._subscriptions.items():
            if self._matches(topic, topic_filter):
                for session, qos in subscriptions:
                    best = max(qos, found.get(session.client_id, (session, 0))[1])
                    found[session.client_id] = (session, best)
        receivers = [each for each in found.values() if self._may_receive(each[0], topic)]
        if len(known) >= CACHED_TOPICS:
            known.clear()
        known[topic] = receivers
        return receivers
