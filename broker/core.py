"""amqtt's broker with the connections, sessions and limits that this system needs; messages are in messages.py."""

from __future__ import annotations

import asyncio
import logging
from functools import partial

from amqtt.events import BrokerEvents
from amqtt.session import Session
from amqtt.utils import gen_client_id

from jouleswarm.broker.access import BAD_CREDENTIALS, Grants, Guard, Refused
from jouleswarm.broker.attempts import source_of
from jouleswarm.broker.connection import Connection
from jouleswarm.broker.errors import MalformedPacket, NotAccepted, PeerGone
from jouleswarm.broker.handler import ClientHandler
from jouleswarm.broker.limits import Limits
from jouleswarm.broker.messages import MessageBroker
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.packets import Connect, Will, parse_connect
from jouleswarm.broker.publication import Publication
from jouleswarm.common.bus.paho_client import name_of
from jouleswarm.common.wire.mqtt import packet_bytes

logger = logging.getLogger("broker")

NO_USER = "its user is one no longer, or has another password"
CONNECT_BYTES = 512 * 1024  # five strings of 64 KB and some


class SwarmBroker(MessageBroker):
    """`amqtt.broker.Broker` fed with connections from outside (see docs/broker.md for what is overridden and why)."""

    def __init__(self, limits: Limits, meter: BrokerMeter, guard: Guard | None = None) -> None:
        super().__init__(limits, meter)
        self.guard = guard

    async def chores(self) -> None:
        """Wait for amqtt's own tasks (sessions that expire), which only a failure ends."""
        tasks = (self._session_monitor_task, self._broadcast_task)
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()

    async def take_out(self) -> None:
        """After users or rights have changed: end who is no user any more, with its session and what waits for it."""
        self._routes.forget()
        for session, handler in tuple(self._sessions.values()):
            if session.grants is None or session.grants.hold:
                continue
            if handler in self.handlers:
                session.clean_session = True  # which ends with its connection
                self.meter.refused("dropped_taken_out", f"client {name_of(session.client_id)} dropped: {NO_USER}")
                logger.warning("client %s dropped: %s", session.client_id, NO_USER)
                handler.connection.abort(NO_USER)
            else:
                await self._delete_session(session.client_id)

    async def serve(self, connection: Connection) -> None:
        """The whole life of one connection, from CONNECT on."""
        try:
            async with asyncio.timeout(self.limits.connect_timeout_s):
                await connection.open()
                first, body, cost_bytes = await connection.reader.read_packet(CONNECT_BYTES)
            self.budget.release(cost_bytes)
            session = self._new_session(parse_connect(first, body), connection)
            session.grants = await self._admit(session, connection)
            session.password = session.ssl_object = None  # a persistent session outlives its connection
            await self._attend(session, connection, packet_bytes(len(body)))
        except TimeoutError:
            reason = f"no CONNECT within {self.limits.connect_timeout_s:g} s"
            self._refuse(connection, "refused_connect_timeout", reason)
        except Refused as error:
            self.meter.refused(error.event, str(error))
            logger.warning("connection from %s:%d refused: %s", *connection.peer, error)
            await self._answer(connection, error.code)
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
        connection.abort(reason)
        self.meter.refused(event, f"{who}: {reason}")
        logger.warning("connection of %s from %s:%d closed: %s", client_id or "a client", host, port, reason)

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
        session.level, session.will, session.grants, session.filters = connect.level, connect.will, None, set()
        session.ssl_object = connection.get_ssl_info()
        session.is_anonymous = False  # amqtt forgets the persistent sessions of anonymous clients within a second
        return session

    async def _attend(self, session: Session, connection: Connection, connect_bytes: int) -> None:
        session = await self._adopt(session)
        if session.grants is not None and not session.grants.hold:  # taken out meanwhile
            raise Refused(BAD_CREDENTIALS, f"user {session.username!r}: {NO_USER}")
        handler = ClientHandler(self, connection, session)
        self.meter.control(session.client_id, "in", connect_bytes)
        if self.meter.by_rule is not None:
            connection.writer.on_control = partial(self.meter.control, session.client_id, "out")
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

    async def _admit(self, session: Session, connection: Connection) -> Grants | None:
        """What the client may do, without a guard everything. Raises Refused."""
        if self.guard is None:
            return None
        told = partial(self._not_permitted, session.client_id)
        return await self.guard.admit(session, source_of(connection.peer[0]), told)

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
