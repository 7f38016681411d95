"""The bus over MQTT 3.1.1. The only place outside `broker/` that an MQTT library is used in."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any, Self

from jouleswarm.common.bus.address import BrokerAddress, parse_url
from jouleswarm.common.bus.bus import Message, matches
from jouleswarm.common.bus.credentials import Credentials
from jouleswarm.common.bus.inbox import Inbox
from jouleswarm.common.bus.paho_client import FastClient, name_of, wire_id
from jouleswarm.common.bus.refusals import SERVER_UNAVAILABLE, closed_early, connack_refusal, refusal, why
from jouleswarm.common.bus.size_limit import SizeLimit
from jouleswarm.common.bus.suspects import CONNECTIONS
from jouleswarm.common.bus.tls import TlsSocket
from jouleswarm.common.errors import BrokerUnreachableError, ConfigurationError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.types import Payload

__all__ = ["BrokerAddress", "MqttBus", "name_of", "parse_url", "wire_id"]

logger = logging.getLogger("bus")

UNSENT_LIMIT_BYTES = 64 * 1024 * 1024
UNSENT_LIMIT_MESSAGES = 10_000
RECONNECT_MIN_S, RECONNECT_MAX_S = 0.1, 2.0
CONNECT_ATTEMPT_MIN_S, CONNECT_ATTEMPT_MAX_S = 3.0, 10.0  # at most as long as the broker waits for a CONNECT
CLOSE_TIMEOUT_S = 5.0
LOOK_AFTER_BROKER_S = 0.2
_REFUSED = 128


class MqttBus:
    """A `common.bus.bus.Bus` on a broker. Make one with `MqttBus.connect`.

    One thread uses it; paho's thread moves the bytes. Its meter counts every PUBLISH packet that was received, or
    written whole (again when it is sent again), under the plain client name.

    What comes is read from the network as long as the user leaves no more than `inbox.BUDGET_BYTES` unread; then TCP
    holds the broker back, whatever its own limits and the QoS are. While the user waits for an answer of the
    broker everything is read: the answer comes last.
    """

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

    @classmethod
    def connect(
        cls,
        url: str,
        client: str,
        *,
        credentials: Credentials | None = None,
        will: tuple[str, bytes] | None = None,
        keepalive_s: int = 60,
        connect_timeout_s: float = 30.0,
        meter: Meter | None = None,
        look_after_broker: Callable[[], None] | None = None,
    ) -> Self:
        """Connect, and keep connected until `close`. `will` is (topic, payload), retained, QoS 1.

        Args:
            url: mqtt://[user:password@]host[:1883], or mqtts://...[:8883] for TLS.
            client: plain name, such as `agent-3`; the id on the wire has a random suffix.
            credentials: user, password and certificates (`bus.credentials`); a user in the URL comes before them.
            connect_timeout_s: how long a broker may be away, now or later, before that is an error.
            meter: one to go on counting with; default a new one.
            look_after_broker: called over and over while the user waits unconnected, in the user's thread: who started
                the broker starts it again. What it raises ends the wait.

        Raises:
            ConfigurationError: the URL is malformed, a certificate is not right, or the broker refused the client.
            BrokerUnreachableError: no broker answered in time.
        """
        bus = cls(parse_url(url), client, connect_timeout_s, credentials, meter, look_after_broker)
        if will is not None:
            bus._paho.will_set(will[0], will[1], qos=1, retain=True)
        bus._paho.connect_async(bus._address.host, bus._address.port, keepalive_s)
        bus._paho.loop_start()
        try:
            bus._wait_for(lambda: bus._connected)
        except BaseException:
            bus._stop()
            raise
        return bus

    def subscribe(self, *filters: str, qos: int = 1) -> None:
        """Subscribe; returns when the broker has granted it. Survives reconnects."""
        with self._changed:
            self._filters |= dict.fromkeys(filters, qos)
            for filter_ in filters:
                self._granted.pop(filter_, None)
            if self._connected:
                self._ask(filters)
        self._wait_for(lambda: all(filter_ in self._granted for filter_ in filters))
        refused = [filter_ for filter_ in filters if self._granted[filter_] >= _REFUSED]
        if refused:
            raise ConfigurationError(f"broker {self._address} refused the subscription to {', '.join(refused)}")

    def unsubscribe(self, *filters: str) -> None:
        """Returns when the broker has confirmed it: nothing more is delivered for these filters."""
        with self._changed:
            filters = tuple(filter_ for filter_ in filters if self._filters.pop(filter_, None) is not None)
            if not filters or not self._connected:
                return
            mid = self._paho.unsubscribe(list(filters))[1]
            if mid is not None:
                self._asked[mid] = filters
        # A lost connection ends the subscriptions too: only those in self._filters are made again.
        self._wait_for(lambda: mid not in self._asked)

    def publish(self, topic: str, payload: Payload, *, qos: int = 1, retain: bool = False) -> None:
        """Queue a message for sending. Waits only while 64 MB or 10 000 messages have not been sent.

        Raises:
            MessageTooLargeError: the broker has told that it takes none of this size.
        """
        self.limit.check(topic, len(payload), qos)
        self._wait_for(self._may_send)
        data = payload if isinstance(payload, bytes | bytearray) else bytes(payload)
        self._paho.send(topic, data, qos, retain=retain)

    def receive(self, timeout_s: float | None = None) -> Message | None:
        """The next message, or None after `timeout_s`. None waits for ever.

        Raises:
            BrokerUnreachableError: the connection was lost and not won back in time.
            MessageTooLargeError: the broker does not take what was published.
        """
        if not self._wait_for(lambda: bool(self._inbox), timeout_s):
            return None
        with self._changed:
            was_full = not self._inbox.has_room(time.monotonic())
            message = self._inbox.take()
        if was_full:
            self._paho.look_again()
        return message

    def flush(self) -> None:
        """Wait until all that was published has been sent, and at QoS 1 acknowledged by the broker."""
        self._wait_for(lambda: self._unsent_messages == 0)

    def close(self) -> None:
        """Flush and disconnect cleanly (no last will).

        Unsubscribes first, so that all that the broker counts as delivered has also been counted here.
        """
        try:
            self.flush()
            self.unsubscribe(*self._filters)
        finally:
            self._stop()

    # In the user's thread

    def _stop(self) -> None:
        self._paho.disconnect()
        with self._changed:
            self._changed.wait_for(lambda: not self._connected or self._failure, CLOSE_TIMEOUT_S)
        self._paho.loop_stop()

    def _may_send(self) -> bool:
        return self._unsent_bytes < UNSENT_LIMIT_BYTES and self._unsent_messages < UNSENT_LIMIT_MESSAGES

    def _wait_for(self, condition: Callable[[], bool], timeout_s: float | None = None) -> bool:
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        with self._changed:
            while not condition():
                if self._failure is not None:
                    raise self._failure
                now_s = time.monotonic()
                waits_s = [] if deadline_s is None else [deadline_s - now_s]
                if not self._connected:
                    if self._look_after_broker is not None:
                        self._look_after_broker()
                        waits_s.append(LOOK_AFTER_BROKER_S)
                    waits_s.append(self._lost_at_s + self._give_up_s - now_s)
                    if waits_s[-1] <= 0:
                        raise self._unreachable()
                if deadline_s is not None and deadline_s <= now_s:
                    return False
                self._awaited = condition
                if not self._inbox.has_room(now_s):
                    self._paho.look_again()
                self._changed.wait(min(waits_s, default=None))
            self._awaited = None
        return True

    def _unreachable(self) -> BrokerUnreachableError:
        return BrokerUnreachableError(
            f"no MQTT broker at {self._address} for {self._give_up_s:g} s ({self._why_lost}); "
            "start one with `python -m broker`, or check --broker"
        )

    def _ask(self, filters: tuple[str, ...]) -> None:
        asked = [(filter_, self._filters[filter_]) for filter_ in filters]
        # A broker that tells none, or not to this client, is as good; one may close the connection at the question.
        if not self._asked_for_limits and self._unanswered < CONNECTIONS // 2:
            asked.append((topics.BROKER_LIMITS, 0))
            self._asked_for_limits = True
        mid = self._paho.subscribe(asked)[1]
        if mid is not None:
            self._asked[mid] = filters

    # In paho's thread

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
                self._failure = connack_refusal(reason.value, str(reason), self._address, self._user)
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
