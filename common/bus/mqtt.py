"""The bus over MQTT 3.1.1. The only place outside `broker/` that an MQTT library is used in."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Self

from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.connection import Connection
from jouleswarm.common.bus.credentials import Credentials
from jouleswarm.common.errors import BrokerUnreachableError, ConfigurationError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.wire.types import Payload

logger = logging.getLogger("bus")

UNSENT_LIMIT_BYTES = 64 * 1024 * 1024
UNSENT_LIMIT_MESSAGES = 10_000
CLOSE_TIMEOUT_S = 5.0
LOOK_AFTER_BROKER_S = 0.2
_REFUSED = 128


class MqttBus(Connection):
    """A `common.bus.bus.Bus` on a broker. Make one with `MqttBus.connect`.

    One thread uses it; paho's thread moves the bytes. Its meter counts every PUBLISH packet that was received, or
    written whole (again when it is sent again), under the plain client name.

    What comes is read from the network as long as the user leaves no more than `inbox.BUDGET_BYTES` unread; then TCP
    holds the broker back, whatever its own limits and the QoS are. While the user waits for an answer of the
    broker everything is read: the answer comes last.
    """

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
