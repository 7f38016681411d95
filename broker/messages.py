"""The broker's messages and subscriptions: the way of a message from its sender to its receivers."""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Awaitable, Callable

from amqtt.broker import Broker
from amqtt.contexts import BrokerConfig
from amqtt.session import Session

from jouleswarm.broker.deliveries import Message
from jouleswarm.broker.handler import ClientHandler
from jouleswarm.broker.holdings import Away, Retained
from jouleswarm.broker.limits import OVERHEAD_BYTES, Budget, Limits, Turns
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.packets import Subscription, is_filter
from jouleswarm.broker.publication import Publication
from jouleswarm.broker.routes import Routes
from jouleswarm.common.bus.paho_client import name_of
from jouleswarm.common.wire import topics

logger = logging.getLogger("broker")

LISTENER = "default"
REFUSED = 0x80
SHARED = "$share/"  # of MQTT 5: a broker without it must not take it for a topic
RETAINED_AT_ONCE = 200  # before others have their turn
_ANONYMOUS = "amqtt.plugins.authentication.AnonymousAuthPlugin"


class MessageBroker(Broker):  # type: ignore[misc]
    """Who has subscribed to what, what is retained, and what is passed on to whom or kept for who is away."""

    def __init__(self, limits: Limits, meter: BrokerMeter) -> None:
        config = BrokerConfig.from_dict(
            {
                "listeners": {LISTENER: {"type": "external"}},
                "plugins": {_ANONYMOUS: {"allow_anonymous": True}},
                "session_expiry_interval": limits.session_expiry_s,
            }
        )
        super().__init__(config)
        self.limits = limits
        self.meter = meter
        self.budget = Budget(limits.memory_bytes)
        self.turns = Turns()
        self.handlers: set[ClientHandler] = set()
        self.on_ask: Callable[[bytes], Awaitable[None]] | None = None
        self._routes = Routes(self._subscriptions, self._matches, self._may_receive)
        self._retained = Retained(limits.retained_bytes)
        self._away = Away(limits.offline_sessions, limits.offline_bytes, limits.all_offline_bytes)

    # Subscriptions

    def add_subscription(self, subscription: Subscription, session: Session) -> int:
        """Grant the QoS that is asked for, or 0x80; a filter that is subscribed to again gets the new QoS."""
        topic_filter, qos = subscription
        if session.grants is not None and not session.grants.may_subscribe(topic_filter):
            self.meter.event("refused_not_permitted")
            return REFUSED
        is_served = is_filter(topic_filter) and not topic_filter.startswith(SHARED)
        is_short = len(topic_filter) <= self.limits.name_length
        has_room = topic_filter in session.filters or len(session.filters) < self.limits.subscriptions
        if not (is_served and is_short and has_room):
            who = name_of(session.client_id)
            self.meter.refused("refused_subscriptions", f"client {who}: subscription to {topic_filter}")
            return REFUSED
        self.remove_subscription(topic_filter, session)
        self._subscriptions.setdefault(topic_filter, []).append((session, qos))
        session.filters.add(topic_filter)
        self._routes.forget()
        return qos

    def remove_subscription(self, topic_filter: str, session: Session) -> None:
        """Nothing more is queued for the session by this filter."""
        session.filters.discard(topic_filter)
        if self._del_subscription(topic_filter, session) and not self._subscriptions[topic_filter]:
            del self._subscriptions[topic_filter]
        self._routes.forget()

    async def _del_all_subscriptions(self, session: Session) -> None:
        for topic_filter in tuple(session.filters):
            self.remove_subscription(topic_filter, session)
        self._routes.forget()

    async def _delete_session(self, client_id: str) -> None:
        self._away.returns(client_id)
        await super()._delete_session(client_id)

    async def _cleanup_session(self, client_id: str) -> None:
        self._away.returns(client_id)
        await super()._cleanup_session(client_id)

    async def deliver_retained(self, handler: ClientHandler, topic_filter: str, qos: int) -> None:
        """Retained messages that a new subscription matches, to this client only, as fast as it reads them."""
        beginning = re.split("[+#]", topic_filter)[0].rstrip("/")
        for number, topic in enumerate(tuple(self._retained_messages)):
            if number % RETAINED_AT_ONCE == RETAINED_AT_ONCE - 1:
                await asyncio.sleep(0)
                await handler.connection.writer.caught_up()
            if not topic.startswith(beginning):
                continue
            # by its newest value: it may have changed while others had their turn
            kept = self._retained_messages.get(topic)
            if kept is None or not self._may_receive(handler.session, topic):
                continue
            if self._matches(topic, topic_filter):
                publication = Publication(topic, memoryview(kept.data), kept.qos)
                handler.deliver(publication, min(qos, kept.qos), retain=True)

    # Messages

    async def accept(self, session: Session | None, publication: Publication, *, retain: bool) -> None:
        """A message from a client or from the broker itself: keep it if retained, pass it on."""
        if session is not None and not self._may_publish(session, publication.topic):
            return
        if retain:
            await self._retain(session, publication)
        for receiver, granted in self._routes.receivers(publication.topic):
            qos = min(publication.qos, granted)
            _, handler = self._sessions.get(receiver.client_id, (None, None))
            if handler in self.handlers:
                handler.deliver(publication, qos)
            elif qos and not receiver.clean_session:
                self._keep(receiver, Message(publication, qos))
        if publication.topic == topics.BROKER_METER_ASK and self.on_ask is not None:
            await self.on_ask(bytes(publication.payload))

    def has_receivers(self, topic: str) -> bool:
        """Whether anybody would get a message on this topic."""
        return bool(self._routes.receivers(topic))

    def _may_publish(self, session: Session, topic: str) -> bool:
        if session.grants is not None and not session.grants.may_publish(topic):
            self.meter.event("refused_not_permitted")
            return False
        if topic[0] == "$":  # the broker's own (section 4.7.2)
            self.meter.refused("refused_reserved", f"client {name_of(session.client_id)}: message on {topic}")
            return False
        return True

    def _may_receive(self, session: Session, topic: str) -> bool:
        return session.grants is None or bool(session.grants.may_receive(topic))

    async def _retain(self, session: Session | None, publication: Publication) -> None:
        topic, payload = publication.topic, publication.payload
        # What the broker itself retains is small, and must not make way for what clients do.
        if session is None or self._retained.book(topic, len(payload)):
            await self.retain_message(session, topic, payload, publication.qos)
        else:
            who, limit_bytes = name_of(session.client_id), self.limits.retained_bytes
            text = f"client {who}: message to be retained on {topic}, {limit_bytes} bytes are kept of all together"
            self.meter.refused("refused_retained", text)
            logger.warning("%s", text)
            await self.retain_message(session, topic, b"", 0)  # better none than one that is out of date

    def patience_s(self, handler: ClientHandler) -> float:
        """How long a client may make no progress: less while it holds more than its share of what others wait for."""
        limits, share_bytes = self.limits, self.budget.limit_bytes // max(1, len(self.handlers))
        if self.budget.is_pressed and handler.held_bytes > share_bytes:
            return min(limits.pressed_stall_timeout_s, limits.stall_timeout_s)
        return limits.stall_timeout_s

    def _keep(self, session: Session, message: Message) -> None:
        """Hold a message for a persistent session that is away, up to a limit."""
        topic, payload = message.publication.topic, message.publication.payload
        if session.clean_session:
            self.meter.event("dropped_offline")
        elif self._away.keep(session.client_id, len(payload) + OVERHEAD_BYTES):
            kept = Publication(topic, payload, message.qos)
            session.retained_messages.put_nowait(message._replace(publication=kept))
        else:
            text = f"client {name_of(session.client_id)} is away, and too much waits for it: a message was dropped"
            self.meter.refused("dropped_offline", text)

    async def _broadcast_message(
        self, session: Session | None, topic: str, data: bytes, force_qos: int | None = None
    ) -> None:
        """amqtt's way to publish; its own loop would build the text of every payload for a log line."""
        await self.accept(session, Publication(topic, memoryview(data), force_qos or 0), retain=False)
