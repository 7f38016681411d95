"""The bus that processes talk over, as a protocol, and its in-memory form for unit tests and searches."""

from __future__ import annotations

import queue
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol

from paho.mqtt.matcher import MQTTMatcher

from jouleswarm.common.errors import MessageTooLargeError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.wire.mqtt import publish_body_bytes
from jouleswarm.common.wire.types import Payload


@dataclass(frozen=True)
class Message:
    """One message as a subscriber gets it."""

    topic: str
    payload: Payload
    retained: bool = False


class Bus(Protocol):
    """A publish/subscribe client with exact byte counters.

    One thread uses a bus: it publishes, and takes what has arrived with `receive`, in order of arrival.
    """

    client: str
    meter: Meter
    connections: int
    """How often it has connected: after a loss what others sent meanwhile has not come. What it had published retained
    it publishes again by itself."""

    def subscribe(self, *filters: str, qos: int = 1) -> None:
        """Subscribe (MQTT filters, + and #); returns when the broker has granted it. Survives reconnects."""

    def unsubscribe(self, *filters: str) -> None:
        """Returns when the broker has confirmed it: nothing more is delivered for these filters."""

    def publish(self, topic: str, payload: Payload, *, qos: int = 1, retain: bool = False) -> None:
        """Queue a message for sending; returns without waiting for the network. `payload` must not change.

        Messages go out in this order. Over a lost connection a retained topic keeps its newest word only.

        Raises:
            MessageTooLargeError: the broker does not take one of this size; `receive` and `flush` raise it too.
        """

    def receive(self, timeout_s: float | None = None) -> Message | None:
        """The next message, or None after `timeout_s`. None waits for ever.

        Raises:
            BrokerUnreachableError: the connection was lost and not won back in time.
        """

    def flush(self) -> None:
        """Wait until all that was published has been sent, and at QoS 1 acknowledged by the broker."""

    def close(self) -> None:
        """Flush and disconnect cleanly (no last will)."""


@dataclass
class MemoryHub:
    """The broker of `MemoryBus` clients: one process, threads, no copies. Counts as the broker side does."""

    meter: Meter = field(default_factory=lambda: Meter("broker"))
    limit_bytes: int | None = None
    """Of a PUBLISH packet's remaining length."""
    _clients: dict[str, MemoryBus] = field(default_factory=dict)
    _granted: MQTTMatcher = field(default_factory=MQTTMatcher)
    """By filter the QoS of each bus: a tree, so that a message costs the same however many clients there are."""
    _retained: dict[str, Message] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def connect(self, client: str) -> MemoryBus:
        """A new client of this hub."""
        bus = MemoryBus(client, self)
        with self._lock:
            self._clients[client] = bus
        return bus

    def route(self, client: str, message: Message, qos: int, retain: bool) -> None:
        """Deliver to every client with a matching subscription, and keep retained messages."""
        with self._lock:
            self.meter.publish(client, message.topic, "in", len(message.payload), qos)
            if retain:
                self._retained[message.topic] = Message(message.topic, message.payload, retained=True)
            receivers: dict[MemoryBus, int] = {}
            for granted in self._granted.iter_match(message.topic):  # type: ignore[no-untyped-call]
                for bus, highest in granted.items():
                    receivers[bus] = max(highest, receivers.get(bus, 0))  # once each, at its highest QoS
            for bus, highest in receivers.items():
                if self._clients[bus.client] is bus:  # who has come again by its name takes its place
                    self._deliver(bus, message, min(qos, highest))

    def subscribe(self, bus: MemoryBus, filter_: str, qos: int) -> None:
        """Grant it, and deliver what is retained."""
        with self._lock:
            try:
                self._granted[filter_][bus] = qos
            except KeyError:
                self._granted[filter_] = {bus: qos}
            exact = not {"+", "#"} & set(filter_.split("/"))
            for topic in {filter_} & self._retained.keys() if exact else self._retained:
                message = self._retained[topic]
                if (exact or matches(filter_, topic)) and len(message.payload):
                    self._deliver(bus, message, qos)

    def unsubscribe(self, bus: MemoryBus, *filters: str) -> None:
        """Take back what was granted; a filter that was not is passed over."""
        with self._lock:
            for filter_ in filters:
                with suppress(KeyError):
                    del self._granted[filter_][bus]

    def _deliver(self, bus: MemoryBus, message: Message, qos: int) -> None:
        self.meter.publish(bus.client, message.topic, "out", len(message.payload), qos)
        bus.deliver(message, qos)


class MemoryBus:
    """A `Bus` without a network: what is published is in the subscribers' queues when publish returns."""

    def __init__(self, client: str, hub: MemoryHub) -> None:
        self.client = client
        self.meter = Meter("client", cpu_ns=time.thread_time_ns)
        self.connections = 1
        self._hub = hub
        self._filters: set[str] = set()
        self._inbox: queue.SimpleQueue[Message] = queue.SimpleQueue()

    def subscribe(self, *filters: str, qos: int = 1) -> None:
        for filter_ in filters:
            self._filters.add(filter_)
            self._hub.subscribe(self, filter_, qos)

    def unsubscribe(self, *filters: str) -> None:
        self._filters -= set(filters)
        self._hub.unsubscribe(self, *filters)

    def publish(self, topic: str, payload: Payload, *, qos: int = 1, retain: bool = False) -> None:
        size, limit_bytes = len(payload), self._hub.limit_bytes
        if limit_bytes is not None and (body_bytes := publish_body_bytes(topic, size, qos)) > limit_bytes:
            raise MessageTooLargeError(f"message of {body_bytes} bytes on {topic}: the hub takes at most {limit_bytes}")
        self.meter.publish(self.client, topic, "out", size, qos)
        self._hub.route(self.client, Message(topic, payload), qos, retain)

    def receive(self, timeout_s: float | None = None) -> Message | None:
        try:
            return self._inbox.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def flush(self) -> None:
        """Nothing is ever under way."""

    def close(self) -> None:
        self.unsubscribe(*self._filters)

    def deliver(self, message: Message, qos: int) -> None:
        """Called by the hub, from any thread."""
        self.meter.publish(self.client, message.topic, "in", len(message.payload), qos)
        self._inbox.put(message)


def matches(filter_: str, topic: str) -> bool:
    """Whether an MQTT topic filter matches a topic (MQTT 3.1.1, section 4.7)."""
    levels, wanted = topic.split("/"), filter_.split("/")
    if topic.startswith("$") and wanted[0] in ("#", "+"):  # 4.7.2-1
        return False
    if wanted[-1] == "#":
        wanted.pop()
        levels = levels[: len(wanted)]
    return len(levels) == len(wanted) and all(want in ("+", level) for want, level in zip(wanted, levels, strict=True))
