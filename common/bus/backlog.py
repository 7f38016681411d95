"""paho's client made to keep the order of messages over reconnects, and the newest word of each retained topic."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode, _ConnectionState

INFLIGHT_MESSAGES = 60_000  # packet identifiers have 16 bits


class BacklogClient(paho.Client):
    """Publishes nothing before the CONNACK, then first what is left from before, the oldest first.

    paho by itself writes what is published between CONNECT and CONNACK at once, before older messages that have not
    been acknowledged. What is retained goes once, at its newest value, also where it had been acknowledged: a
    broker that was started anew knows none of it.

    Callbacks:
        on_queued(payload_bytes): a message is to be sent.
        on_settled(payload_bytes): it needs no more sending (acknowledged, or a newer word takes its place; at QoS 0
            written, or lost).
    """

    on_queued: Callable[[int], None]
    on_settled: Callable[[int], None]

    def __init__(self, client_id: str) -> None:
        super().__init__(CallbackAPIVersion.VERSION2, client_id)
        self.max_inflight_messages = INFLIGHT_MESSAGES
        self._retained: dict[str, bytes | bytearray] = {}

    def send(self, topic: str, payload: bytes | bytearray, qos: int, *, retain: bool) -> None:
        """Publish in the order of calls. At QoS 0 lost where there is no connection."""
        with self._out_message_mutex:  # nobody gets between a CONNACK and the backlog
            if retain:
                self._retained[topic] = payload
            self._queue(topic, payload, qos, retain)

    def backlog(self) -> list[tuple[str, int, int]]:
        """Topic, payload bytes and QoS of all that has not been acknowledged."""
        with self._out_message_mutex:
            return [(each.topic, len(each.payload), each.qos) for each in self._out_messages.values()]

    @property
    def is_open(self) -> bool:
        """Whether the broker has accepted the connection, and messages may be written."""
        return self._sock is not None and self._state == _ConnectionState.MQTT_CS_CONNECTED

    def reconnect(self) -> MQTTErrorCode:
        with self._out_message_mutex:  # from here on what is published waits for the CONNACK
            self._state = _ConnectionState.MQTT_CS_CONNECTING
            lost, self._out_packet = self._out_packet, deque()
        for packet in lost:
            if packet["command"] & 0xF0 == paho.PUBLISH and packet["qos"] == 0:
                self.on_settled(self._payload_bytes(packet["packet"]))
        return super().reconnect()

    def _payload_bytes(self, packet: object) -> int:
        raise NotImplementedError

    def _queue(self, topic: str, payload: bytes | bytearray, qos: int, retain: bool) -> int:
        self.on_queued(len(payload))
        info = self.publish(topic, payload, qos, retain)
        if qos == 0 and info.rc == MQTTErrorCode.MQTT_ERR_NO_CONN:
            self.on_settled(len(payload))
        return info.mid

    def _mid_generate(self) -> int:
        mid = super()._mid_generate()
        while mid in self._out_messages:  # after 65 535 others paho would lose the new message
            mid = super()._mid_generate()
        return mid

    def _handle_connack(self) -> MQTTErrorCode:
        with self._out_message_mutex:
            if bytes(self._in_packet["packet"][1:2]) == b"\0":
                self._put_backlog_in_order()
            return super()._handle_connack()

    def _put_backlog_in_order(self) -> None:
        newest: set[str] = set()
        for mid, message in reversed(tuple(self._out_messages.items())):
            if message.retain and message.topic in newest:
                del self._out_messages[mid]
                self.on_settled(len(message.payload))
            elif message.retain and message.payload:  # an empty one takes no word's place that listeners wait for
                newest.add(message.topic)
        waiting = {message.topic for message in self._out_messages.values() if message.retain}
        for topic, payload in reversed(self._retained.items()):
            if topic not in waiting:  # it had been acknowledged: it is older than all that has not
                self._out_messages.move_to_end(self._queue(topic, payload, 1, retain=True), last=False)
