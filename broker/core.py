"""amqtt's broker with the routing, sessions and limits that this system needs."""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Awaitable, Callable
from functools import partial

from amqtt.broker import Broker
from amqtt.contexts import BrokerConfig
from amqtt.events import BrokerEvents
from amqtt.session import Session
from amqtt.utils import gen_client_id

from jouleswarm.broker.access import Guard, Refused
from jouleswarm.broker.connection import Connection
from jouleswarm.broker.deliveries import Message
from jouleswarm.broker.errors import MalformedPacket, NotAccepted, PeerGone
from jouleswarm.broker.handler import ClientHandler
from jouleswarm.broker.holdings import Away, Filters, Retained
from jouleswarm.broker.limits import OVERHEAD_BYTES, Budget, Limits, Turns
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.packets import Connect, Subscription, Will, is_filter, parse_connect
from jouleswarm.broker.publication import Publication
from jouleswarm.broker.routes import Routes
from jouleswarm.common.bus.paho_client import name_of
from jouleswarm.common.wire import topics

logger = logging.getLogger("broker")

LISTENER = "default"
REFUSED = 0x80
SHARED = "$share/"  # of MQTT 5: a broker without it must not take it for a topic
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

    async def chores(self) -> None:
        """Wait for amqtt's own tasks (sessions that expire), which only a failure ends."""
        tasks = (self._session_monitor_task, self._broadcast_task)
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()

    # Connections

    async def serve(self, connection: Connection) -> None:
        """The whole life of one connection, from CONNECT on."""
        try:
            async with asyncio.timeout(self.limits.connect_timeout_s):
                await connection.open()
                first, body, cost_bytes = await connection.reader.read_packet(CONNECT_BYTES)
            self.budget.release(cost_bytes)
            session = self._new_session(parse_connect(first, body), connection)
            if await self._is_admitted(session, connection):
                await self._attend(session, connection)
        except TimeoutError:
            reason = f"no CONNECT within {self.limits.connect_timeout_s:g} s"
            self._refuse(connection, "refused_connect_timeout", reason)
        except NotAccepted as error:
            await self._answer(connection, error.code)
            self._refuse(connection, error.event, str(error))
        except MalformedPacket as error:
            self._refuse(connection, error.event, str(error))
        except PeerGone as error:
            logger.debug("%s: %s", connection.peer, error)
        finally:
            connection.abort("the session has ended")

    def _refuse(self, connection: Connection, event: str, reason: str, client_id: str | None = None) -> None:
        host, port = connection.peer
        who = f"client {name_of(client_id)}" if client_id else f"a client at {host}"
        self.meter.refused(event, f"{who}: {reason}")
        logger.warning("connection of %s from %s:%d closed: %s", client_id or "a client", host, port, reason)
        connection.abort(reason)

    async def _answer(self, connection: Connection, code: int) -> None:
        connection.send(bytes((0x20, 2, 0, code)))  # CONNACK (section 3.2)
        await connection.close()

    def _new_session(self, connect: Connect, connection: Connection) -> Session:
        names = (connect.client_id, connect.will.topic if connect.will else "")
        if any(len(name) > self.limits.name_length for name in names):
            raise MalformedPacket(f"CONNECT with a client id or a topic of over {self.limits.name_length} characters")
        session = Session()
        session.client_id = connect.client_id or gen_client_id()
        session.clean_session, session.keep_alive = connect.clean_session, connect.keepalive_s
        session.username, session.password = connect.username, connect.password
        session.level, session.will, session.grants = connect.level, connect.will, None
        session.ssl_object = connection.get_ssl_info()
        session.is_anonymous = False  # amqtt forgets the persistent sessions of anonymous clients within a second
        return session

    async def _attend(self, session: Session, connection: Connection) -> None:
        session = await self._adopt(session)
        handler = ClientHandler(self, connection, session)
        session.transitions.connect()
        self._sessions[session.client_id] = (session, handler)
        connection.send(bytes((0x20, 2, session.parent if session.level > 3 else 0, 0)))  # CONNACK
        self.handlers.add(handler)
        self._routes.forget()
        try:
            self._resume(session, handler)
            await self._fire(BrokerEvents.CLIENT_CONNECTED, session)
            await handler.serve()
        except MalformedPacket as error:
            self._refuse(connection, error.event, str(error), session.client_id)
        finally:
            await self._leave(session, handler)

    async def _is_admitted(self, session: Session, connection: Connection) -> bool:
        """Whether the client may connect; one that may not is told why not, and goes."""
        if self._guard is None:
            return True
        try:
            session.grants = await self._guard.admit(session, partial(self._not_permitted, session.client_id))
        except Refused as refused:
            self.meter.refused("refused_not_authorized", str(refused))
            logger.warning("connection from %s:%d refused: %s", *connection.peer, refused)
            await self._answer(connection, refused.code)
            return False
        session.password = session.ssl_object = None  # a persistent session outlives its connection
        return True

    def _not_permitted(self, client_id: str, what: str) -> None:
        self.meter.refusals.add(f"client {name_of(client_id)} may not {what}: no right for it in the rights file")
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
        old.level, old.will, old.grants = session.level, session.will, session.grants
        old.keep_alive, old.username, old.password = session.keep_alive, session.username, session.password
        old.parent = 1
        return old

    def _resume(self, session: Session, handler: ClientHandler) -> None:
        handler.deliveries.resume()
        self._away.returns(session.client_id)
        while not session.retained_messages.empty():
            publication, qos, retain = session.retained_messages.get_nowait()
            handler.deliver(publication, qos, retain=retain)

    async def _leave(self, session: Session, handler: ClientHandler) -> None:
        handler.connection.abort("the session has ended")
        why = "DISCONNECT" if handler.left_cleanly else handler.connection.closed_because
        logger.info("client %s left: %s", session.client_id, why)
        self.handlers.discard(handler)
        self._routes.forget()
        session.transitions.disconnect()
        waiting = handler.deliveries.suspend()
        if not session.clean_session:
            for client_id in self._away.leaves(session.client_id, handler.deliveries.kept_bytes):
                self.meter.event("dropped_sessions")
                await self._delete_session(client_id)
        for message in waiting:
            self._keep(session, message)
            message.publication.drop()
        if session.clean_session:
            await self._delete_session(session.client_id)
        try:
            if session.will is not None and not handler.left_cleanly:
                await self._publish_will(session, session.will)
            await self._fire(BrokerEvents.CLIENT_DISCONNECTED, session)
        finally:
            handler.left.set()

    async def _publish_will(self, session: Session, will: Will) -> None:
        await self.accept(session, Publication(will.topic, memoryview(will.payload), will.qos), retain=will.retain)

    async def _fire(self, event: BrokerEvents, session: Session) -> None:
        await self.plugins_manager.fire_event(event, client_id=session.client_id, client_session=session)

    # Subscriptions

    def add_subscription(self, subscription: Subscription, session: Session) -> int:
        """Grant the QoS that is asked for, or 0x80; a filter that is subscribed to again gets the new QoS."""
        topic_filter, qos = subscription
        client_id = session.client_id
        if session.grants is not None and not session.grants.may_subscribe(topic_filter):
            self.meter.event("refused_not_permitted")
            return REFUSED
        is_served = is_filter(topic_filter) and not topic_filter.startswith(SHARED)
        is_short = len(topic_filter) <= self.limits.name_length
        if not (is_served and is_short and self._filters.has_room(client_id, topic_filter)):
            self.meter.refused("refused_subscriptions", f"client {name_of(client_id)}: subscription to {topic_filter}")
            return REFUSED
        self.remove_subscription(topic_filter, session)
        self._subscriptions.setdefault(topic_filter, []).append((session, qos))
        self._filters.add(client_id, topic_filter)
        self._routes.forget()
        return qos

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
