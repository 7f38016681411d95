"""amqtt's broker with the routing, sessions and limits that this system needs."""

from __future__ import annotations

import asyncio
import logging
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
from broker.limits import OVERHEAD_BYTES, Budget, Limits, Turns
from broker.meter import BrokerMeter
from broker.packets import CODEC_ERRORS, check_connect, is_topic
from broker.publication import Publication
from broker.routes import Routes
from common import topics

logger = logging.getLogger("broker")

LISTENER = "default"
REFUSED = 0x80
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
        self.on_ask: Callable[[str], Awaitable[None]] | None = None
        self._routes = Routes(self._subscriptions, self._matches, self._may_receive)
        self._offline: dict[str, int] = {}

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
        self._offline.pop(session.client_id, None)
        while not session.retained_messages.empty():
            handler.deliver(session.retained_messages.get_nowait(), 1)

    async def _leave(self, session: Session, handler: ClientHandler) -> None:
        handler.connection.abort("the session has ended")
        why = "DISCONNECT" if handler.left_cleanly else handler.connection.closed_because
        logger.info("client %s left: %s", session.client_id, why)
        self.handlers.discard(handler)
        self._routes.forget()
        session.transitions.disconnect()
        for publication in handler.suspend():
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
        if not topic_filter or "\0" in topic_filter:
            return REFUSED
        if session.grants is not None and not session.grants.may_subscribe(topic_filter):
            self.meter.event("refused_not_permitted")
            return REFUSED
        self.remove_subscription(topic_filter, session)
        granted: int = await super().add_subscription((topic_filter, min(qos, 1)), session)
        self._routes.forget()
        return granted

    def remove_subscription(self, topic_filter: str, session: Session) -> None:
        """Nothing more is queued for the session by this filter."""
        if self._del_subscription(topic_filter, session) and not self._subscriptions[topic_filter]:
            del self._subscriptions[topic_filter]
        self._routes.forget()

    async def _del_all_subscriptions(self, session: Session) -> None:
        await super()._del_all_subscriptions(session)
        self._routes.forget()

    def deliver_retained(self, handler: ClientHandler, topic_filter: str, qos: int) -> None:
        """Retained messages that a new subscription matches, to this client only."""
        for topic, kept in tuple(self._retained_messages.items()):
            if self._matches(topic, topic_filter) and self._may_receive(handler.session, topic):
                publication = Publication(topic, memoryview(kept.data), kept.qos)
                handler.deliver(publication, min(qos, kept.qos), retain=True)

    # Messages

    async def accept(self, session: Session | None, publication: Publication, *, retain: bool) -> None:
        """A message from a client or from the broker itself: keep it if retained, pass it on."""
        if session is not None and session.grants is not None and not session.grants.may_publish(publication.topic):
            self.meter.event("refused_not_permitted")
            return
        if retain:
            await self.retain_message(session, publication.topic, publication.payload, publication.qos)
        for receiver, granted in self._routes.receivers(publication.topic):
            qos = min(publication.qos, granted)
            _, handler = self._sessions.get(receiver.client_id, (None, None))
            if handler in self.handlers:
                handler.deliver(publication, qos)
            elif qos and not receiver.clean_session:
                self._keep(receiver, publication)
        if publication.topic == topics.BROKER_METER_ASK and self.on_ask is not None:
            await self.on_ask(bytes(publication.payload).decode(errors="replace"))

    def _may_receive(self, session: Session, topic: str) -> bool:
        return session.grants is None or bool(session.grants.may_receive(topic))

    def _keep(self, session: Session, publication: Publication) -> None:
        """Hold a QoS 1 message for a persistent session that is away, up to a limit."""
        held_bytes = self._offline.get(session.client_id, 0) + len(publication.payload) + OVERHEAD_BYTES
        if session.clean_session or held_bytes > self.limits.offline_bytes:
            self.meter.event("dropped_offline")
            return
        self._offline[session.client_id] = held_bytes
        kept = Publication(publication.topic, publication.payload, publication.qos)
        session.retained_messages.put_nowait(kept)

    async def _broadcast_message(
        self, session: Session | None, topic: str, data: bytes, force_qos: int | None = None
    ) -> None:
        """amqtt's way to publish; its own loop would build the text of every payload for a log line."""
        await self.accept(session, Publication(topic, memoryview(data), force_qos or 0), retain=False)
