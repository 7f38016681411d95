"""One client's connection to a broker, as paho's thread tells of it; what its user does with it is in mqtt.py."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from jouleswarm.common.bus.address import BrokerAddress
from jouleswarm.common.bus.bus import Message, matches
from jouleswarm.common.bus.credentials import Credentials
from jouleswarm.common.bus.inbox import Inbox
from jouleswarm.common.bus.paho_client import FastClient, wire_id
from jouleswarm.common.bus.refusals import SERVER_UNAVAILABLE, closed_early, connack_refusal, refusal, why
from jouleswarm.common.bus.size_limit import SizeLimit
from jouleswarm.common.bus.suspects import CONNECTIONS
from jouleswarm.common.bus.tls import TlsSocket
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.wire import topics

RECONNECT_MIN_S, RECONNECT_MAX_S = 0.1, 2.0
DOUBTED = CONNECTIONS // 2  # unanswered SUBSCRIBEs after which the next is asked for less, and by another client id
CONNECT_ATTEMPT_MIN_S, CONNECT_ATTEMPT_MAX_S = 3.0, 10.0  # at most as long as the broker waits for a CONNECT


class Connection:
    """What two threads know of it, under one lock: its user's, and paho's, which calls all that begins with `_on`."""

    def __init__(
        self,
        address: BrokerAddress,
        client: str,
        give_up_s: float,
        credentials: Credentials | None = None,
        meter: Meter | None = None,
        look_after_broker: Callable[[], None] | None = None,
    ) -> None:
        self.client = client
        self.meter = meter or Meter("client")
        self._look_after_broker = look_after_broker
        self.connections = 0
        self._address = address
        self._give_up_s = give_up_s
        self._changed = threading.Condition()
        self._inbox = Inbox()
        self._awaited: Callable[[], bool] | None = None
        self.limit = SizeLimit(address)
        self._asked_for_limits = False
        self._unanswered = 0  # connections in a row that ended before a SUBSCRIBE was answered
        self._filters: dict[str, int] = {}
        self._granted: dict[str, int] = {}
        self._asked: dict[int, tuple[str, ...]] = {}
        self._unsent_messages = self._unsent_bytes = 0
        self._connected = False
        self._lost_at_s = time.monotonic()
        self._why_lost, self._why_refused = "no answer", ""
        self._failure: BaseException | None = None
        self._paho = self._new_paho(address, credentials)

    def _ask(self, filters: tuple[str, ...]) -> None:
        asked = [(filter_, self._filters[filter_]) for filter_ in filters]
        # A broker that tells none, or not to this client, is as good; one may close the connection at the question.
        if not self._asked_for_limits and self._unanswered < DOUBTED:
            asked.append((topics.BROKER_LIMITS, 0))
            self._asked_for_limits = True
        mid = self._paho.subscribe(asked)[1]
        if mid is not None:
            self._asked[mid] = filters

    def _new_paho(self, address: BrokerAddress, credentials: Credentials | None) -> FastClient:
        client = FastClient(wire_id(self.client))
        # On a machine that has too much to do a handshake takes long, and one that is given up was for nothing.
        client.connect_timeout = max(CONNECT_ATTEMPT_MIN_S, min(self._give_up_s / 3, CONNECT_ATTEMPT_MAX_S))
        if credentials is not None and not address.tls:
            raise ConfigurationError(
                f"broker {address} with keys: the password would go unencrypted; expected mqtts://HOST:PORT"
            )
        if address.tls:
            context = (credentials or Credentials()).context()
            context.sslsocket_class = TlsSocket
            client.tls_set_context(context)
        shown = address if address.user or credentials is None else credentials
        self._user = shown.user
        client.username_pw_set(shown.user, shown.password)
        client.reconnect_delay_set(RECONNECT_MIN_S, RECONNECT_MAX_S)  # type: ignore[arg-type]  # floats work
        client.on_connect = self._on_connect
        client.on_unreachable = self._on_unreachable
        client.on_disconnect = self._on_disconnect
        client.on_subscribe = self._on_subscribe
        client.on_unsubscribe = self._on_unsubscribe
        client.on_sent = self._on_sent
        client.on_received = self._on_received
        client.has_room = self._has_room
        client.on_queued = self._on_queued
        client.on_settled = self._on_settled
        client.on_not_taken = self.limit.not_taken
        client.on_failure = self._on_failure
        return client

    def _on_connect(self, _client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        with self._changed:
            if reason.value == SERVER_UNAVAILABLE:  # it is starting or overloaded: paho tries again
                self._why_refused = "refused: server unavailable"
            elif reason.is_failure:
                told = reason.value, str(reason), self._address, self._user
                self._failure = connack_refusal(*told, was_let_in=self.connections > 0)
            else:
                self._connected = True
                self.connections += 1
                self.limit.told_bytes, self._asked_for_limits = None, False
                if self._filters:
                    self._ask(tuple(self._filters))
            self._changed.notify_all()

    def _on_unreachable(self, error: OSError) -> None:
        if (mistake := refusal(error, self._address)) is not None:
            raise mistake  # ends the network thread: waiting would not mend it
        self._why_lost = why(error)

    def _on_disconnect(self, _client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        with self._changed:
            unanswered = tuple(filter_ for filters in self._asked.values() for filter_ in filters)
            self._unanswered = self._unanswered + 1 if unanswered else self._unanswered
            if self._unanswered >= DOUBTED:
                # A cluster may keep what belongs to the old id on a node that is down (RabbitMQ: its queue).
                self._paho.rename(wire_id(self.client))
            if self._connected:
                self._connected, self._lost_at_s = False, time.monotonic()
                self._why_lost = f"connection lost: {reason}"
            else:
                self._why_lost, self._why_refused = self._why_refused or closed_early(self._address), ""
            self._granted.clear()
            self._asked.clear()
            self._changed.notify_all()
        if self._unanswered >= CONNECTIONS:
            raise ConfigurationError(
                f"broker {self._address} refused the subscription to {', '.join(unanswered)}: it closed the connection "
                f"{CONNECTIONS} times in a row without an answer"
            )

    def _on_subscribe(self, _client: Any, _data: Any, mid: int, reasons: Any, _properties: Any) -> None:
        with self._changed:
            self._unanswered = 0
            for filter_, reason in zip(self._asked.pop(mid, ()), reasons, strict=False):
                self._granted[filter_] = reason.value
            self._changed.notify_all()

    def _on_unsubscribe(self, _client: Any, _data: Any, mid: int, _reasons: Any, _properties: Any) -> None:
        with self._changed:
            self._asked.pop(mid, None)
            self._changed.notify_all()

    def _on_sent(self, topic: str, payload_bytes: int, packet_bytes: int) -> None:
        self.meter.count(self.client, topic, "out", payload_bytes, packet_bytes)

    def _on_received(self, topic: str, payload: memoryview, retained: bool, packet_bytes: int) -> None:
        if topic == topics.BROKER_LIMITS:
            self.limit.learn(payload)
            for waiting in self._paho.backlog():
                self.limit.check(*waiting)
            if not any(matches(filter_, topic) for filter_ in tuple(self._filters)):
                return
        self.meter.count(self.client, topic, "in", len(payload), packet_bytes)
        with self._changed:
            self._inbox.put(Message(topic, payload, retained))
            self._changed.notify_all()

    def _has_room(self) -> bool:
        with self._changed:
            awaits = self._awaited is not None and not self._awaited()
            return awaits or self._inbox.has_room(time.monotonic())

    def _on_queued(self, payload_bytes: int) -> None:
        with self._changed:
            self._unsent_messages += 1
            self._unsent_bytes += payload_bytes

    def _on_settled(self, payload_bytes: int) -> None:
        with self._changed:
            self._unsent_messages -= 1
            self._unsent_bytes -= payload_bytes
            self._changed.notify_all()

    def _on_failure(self, error: BaseException) -> None:
        with self._changed:
            self._failure = error
            self._changed.notify_all()
