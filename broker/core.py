"""amqtt's broker with the routing, sessions and limits that this system needs."""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

from amqtt.adapters import BufferReader
from amqtt.broker import Broker
from amqtt.contexts import BrokerConfig
from amqtt.events import BrokerEvents
from amqtt.mqtt.packet import CONNECT, MQTTFixedHeader
from amqtt.mqtt.protocol.broker_handler import BrokerProtocolHandler
from amqtt.session import Session

from broker.access import Guard, Refused
from broker.connection import Connection
from broker.errors import MalformedPacket, PeerGone
from broker.handler import ClientHandler
from broker.holdings import Away, Filters, Retained
from broker.limits import OVERHEAD_BYTES, Budget, Limits, Turns
from broker.meter import BrokerMeter
from broker.packets import CODEC_ERRORS, check_connect, is_topic
from broker.publication import Publication
from broker.routes import Routes
from common import topics

logger = logging.getLogger("broker")

LISTENER = "default"
REFUSED = 0x80
RETAINED_AT_ONCE = 200  # before others have their turn
CONNECT_BYTES = 512 * 1024  # five strings of 64 KB and some
_ANONYMOUS = "amqtt.plugins.authentication.AnonymousAuthPlugin"


class SwarmBroker(Broker):  # type: ignore[misc]
    """`amqtt.broker.Broker` fed with connections from outside (see README.md for what is overridden and why)."""

    def __init__(self, limits: Limits, meter: BrokerMeter, guard: Guard | None = None) -> None:
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
        self._guard = guard
        self.budget = Budget(limits.memory_bytes)
        self.turns = Turns()
        self.handlers: set[ClientHandler] = set()
        self.on_ask: Callable[[bytes], Awaitable[None]] | None = None
        self._routes = Routes(self._subscriptions, self._matches, self._may_receive)
        self._retained = Retained(limits.retained_bytes)
        self._filters = Filters(limits.subscriptions)
        self._away = Away(limits.offline_sessions, limits.offline_bytes, limits.all_offline_bytes)

    # Connections

    async def serve(self, connection: Connection) -> None:
        """The whole life of one connection, from CONNECT on."""
        try:
            async with asyncio.timeout(self.limits.connect_timeout_s):
                await connection.open()
                first, body, cost_bytes = await connection.reader.read_packet(CONNECT_BYTES)
            self.budget.release(cost_bytes)
            check_connect(first, body)
            fixed = MQTTFixedHeader(CONNECT, 0, len(body)).to_bytes()
            await self.external_connected(BufferReader(fixed + body), connection, LISTENER)
        except TimeoutError:
            reason = f"no CONNECT within {self.limits.connect_timeout_s:g} s"
            self._refuse(connection, "refused_connect_timeout", reason)
        except MalformedPacket as error:
            self._refuse(connection, error.event, str(error))
        except PeerGone as error:
            logger.debug("%s: %s", connection.peer, error)
        finally:
            connection.abort("the session has ended")

    def _refuse(self, connection: Connection, event: str, reason: str) -> None:
        self.meter.event(event)
        logger.warning("connection from %s:%d closed: %s", *connection.peer, reason)
        connection.abort(reason)

    async def _initialize_client_session(
        self, reader: BufferReader, writer: Connection, _address: str, _port: int
    ) -> tuple[ClientHandler, Session]:
        try:
            _, session = await BrokerProtocolHandler.init_from_connect(reader, writer, self.plugins_manager)
        except CODEC_ERRORS as error:
            raise MalformedPacket(f"CONNECT: {error}") from error
        names = (session.client_id or "", session.will_topic or "")
        if any(len(name) > self.limits.name_length for name in names):
            raise MalformedPacket(f"CONNECT with a client id or a topic of over {self.limits.name_length} characters")
        if session.will_flag and not is_topic(session.will_topic):
            raise MalformedPacket(f"last will on topic {session.will_topic!r}, which cannot be published on")
        return ClientHandler(self, writer), session

    async def _handle_client_session(
        self, reader: BufferReader, writer: Connection, session: Session, handler: ClientHandler, *_: Any
    ) -> None:
        if not await self._is_admitted(session, writer):
            return
        session = await self._adopt(session)
        handler.attach(session, reader, writer)
        session.transitions.connect()
        self._sessions[session.client_id] = (session, handler)
        self.handlers.add(handler)
        self._routes.forget()
        try:
            await handler.mqtt_connack_authorize(True)
            await self._fire(BrokerEvents.CLIENT_CONNECTED, session)
            self._resume(session, handler)
            await handler.serve()
        except MalformedPacket as error:
            self._refuse(writer, error.event, str(error))
        finally:
            await self._leave(session, handler)

    async def _is_admitted(self, session: Session, connection: Connection) -> bool:
        """Whether the client may connect; one that may not is told why not, and goes."""
        # amqtt forgets the persistent sessions of anonymous clients within a second.
        session.is_anonymous, session.grants = False, None
        if self._guard is None:
            return True
        try:
            session.grants = await self._guard.admit(session, partial(self._not_permitted, session.client_id))
        except Refused as refused:
            self.meter.event("refused_not_authorized")
            logger.warning("connection from %s:%d refused: %s", *connection.peer, refused)
            connection.send(bytes((0x20, 2, 0, refused.code)))  # CONNACK (section 3.2)
            await connection.close()
            return False
        session.password = session.ssl_object = None  # a persistent session outlives its connection
        return True

    def _not_permitted(self, client_id: str, what: str) -> None:
        logger.warning("client %s may not %s: no right for it in the rights file", client_id, what)

    async def _adopt(self, session: Session) -> Session:
        """Take over the client id: end its old connection, then take up its persistent session or drop it."""
        while True:
            old, handler = self._sessions.get(session.client_id, (None, None))
            if handler not in self.handlers:
                break
            self.meter.event("taken_over")
            handler.connection.abort("the client connected anew")
            await handler.left.wait()
        session.parent = 0
        if old is None:
            return session
        if session.clean_session:
            await self._delete_session(session.client_id)
            return session
        for name in ("flag", "topic", "message", "qos", "retain"):
            setattr(old, f"will_{name}", getattr(session, f"will_{name}"))
        old.keep_alive, old.username, old.password = session.keep_alive, session.username, session.password
        old.grants = session.grants
        old.parent = 1
        return old

    def _resume(self, session: Session, handler: ClientHandler) -> None:
        handler.resume()
        self._away.returns(session.client_id)
        while not session.retained_messages.empty():
            handler.deliver(session.retained_messages.get_nowait(), 1)

    async def _leave(self, session: Session, handler: ClientHandler) -> None:
        handler.connection.abort("the session has ended")
        why = "DISCONNECT" if handler.left_cleanly else handler.connection.closed_because
        logger.info("client %s left: %s", session.client_id, why)
        self.handlers.discard(handler)
        self._routes.forget()
        session.transitions.disconnect()
        waiting = handler.suspend()
        if not session.clean_session:
            for client_id in self._away.leaves(session.client_id, handler.kept_bytes):
                self.meter.event("dropped_sessions")
                await self._delete_session(client_id)
        for publication in waiting:
            self._keep(session, publication)
            publication.drop()
        if session.clean_session:
            await self._delete_session(session.client_id)
        try:
            if session.will_flag and not handler.left_cleanly:
                await self._publish_will(session)
            await self._fire(BrokerEvents.CLIENT_DISCONNECTED, session)
        finally:
            handler.left.set()

    async def _publish_will(self, session: Session) -> None:
        will = Publication(session.will_topic, memoryview(session.will_message), min(session.will_qos or 0, 1))
        await self.accept(session, will, retain=bool(session.will_retain))

    async def _fire(self, event: BrokerEvents, session: Session) -> None:
        await self.plugins_manager.fire_event(event, client_id=session.client_id, client_session=session)

    # Subscriptions

    async def add_subscription(self, subscription: tuple[str, int], session: Session) -> int:
        """Grant QoS 0 or 1, or 0x80; a filter that is subscribed to again gets the new QoS."""
        topic_filter, qos = subscription
        client_id = session.client_id
        if not topic_filter or "\0" in topic_filter:
            return REFUSED
        if session.grants is not None and not session.grants.may_subscribe(topic_filter):
            self.meter.event("refused_not_permitted")
            return REFUSED
        if len(topic_filter) > self.limits.name_length or not self._filters.has_room(client_id, topic_filter):
            self.meter.event("refused_subscriptions")
            return REFUSED
        self.remove_subscription(topic_filter, session)
        granted: int = await super().add_subscription((topic_filter, min(qos, 1)), session)
        if granted != REFUSED:
            self._filters.add(client_id, topic_filter)
        self._routes.forget()
        return granted

    def remove_subscription(self, topic_filter: str, session: Session) -> None:
        """Nothing more is queued for the session by this filter."""
        self._filters.discard(session.client_id, topic_filter)
        if self._del_subscription(topic_filter, session) and not self._subscriptions[topic_filter]:
            del self._subscriptions[topic_filter]
        self._routes.forget()

    async def _del_all_subscriptions(self, session: Session) -> None:
        for topic_filter in self._filters.pop(session.client_id):
            self.remove_subscription(topic_filter, session)
        self._routes.forget()

    async def _delete_session(self, client_id: str) -> None:
        self._away.returns(client_id)
        await super()._delete_session(client_id)

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
        if session is not None and session.grants is not None and not session.grants.may_publish(publication.topic):
            self.meter.event("refused_not_permitted")
            return
        if retain:
            await self._retain(session, publication)
        for receiver, granted in self._routes.receivers(publication.topic):
            qos = min(publication.qos, granted)
            _, handler = self._sessions.get(receiver.client_id, (None, None))
            if handler in self.handlers:
                handler.deliver(publication, qos)
            elif qos and not receiver.clean_session:
                self._keep(receiver, publication)
        if publication.topic == topics.BROKER_METER_ASK and self.on_ask is not None:
            await self.on_ask(bytes(publication.payload))

    def has_receivers(self, topic: str) -> bool:
        """Whether anybody would get a message on this topic."""
        return bool(self._routes.receivers(topic))

    def _may_receive(self, session: Session, topic: str) -> bool:
        return session.grants is None or bool(session.grants.may_receive(topic))

    async def _retain(self, session: Session | None, publication: Publication) -> None:
        topic, payload = publication.topic, publication.payload
        # What the broker itself retains is small, and must not make way for what clients do.
        if session is None or self._retained.book(topic, len(payload)):
            await self.retain_message(session, topic, payload, publication.qos)
        else:
            self.meter.event("refused_retained")
            await self.retain_message(session, topic, b"", 0)  # better none than one that is out of date

    def patience_s(self, handler: ClientHandler) -> float:
        """How long a client may make no progress: less while it holds more than its share of what others wait for."""
        limits, share_bytes = self.limits, self.budget.limit_bytes // max(1, len(self.handlers))
        if self.budget.is_pressed and handler.held_bytes > share_bytes:
            return min(limits.pressed_stall_timeout_s, limits.stall_timeout_s)
        return limits.stall_timeout_s

    def _keep(self, session: Session, publication: Publication) -> None:
        """Hold a QoS 1 message for a persistent session that is away, up to a limit."""
        size_bytes = len(publication.payload) + OVERHEAD_BYTES
        if session.clean_session or not self._away.keep(session.client_id, size_bytes):
            self.meter.event("dropped_offline")
            return
        kept = Publication(publication.topic, publication.payload, publication.qos)
        session.retained_messages.put_nowait(kept)

    async def _broadcast_message(
        self, session: Session | None, topic: str, data: bytes, force_qos: int | None = None
    ) -> None:
        """amqtt's way to publish; its own loop would build the text of every payload for a log line."""
        await self.accept(session, Publication(topic, memoryview(data), force_qos or 0), retain=False)
