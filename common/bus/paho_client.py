"""The MQTT client under `MqttBus`: paho's, made fast for large messages and exact in what it counts.

paho appends what it receives piece by piece and decodes the packet with three copies, and copies the rest of a
packet at every send. The methods overridden here are paho's private ones (2.2); the network thread,
reconnection, acknowledgements and keepalive remain paho's.
"""

from __future__ import annotations

import logging
import re
import secrets
import socket
import ssl
import time
from collections.abc import Callable
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import MQTTErrorCode, _ConnectionState
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from jouleswarm.common.bus.reading_client import ReadingClient
from jouleswarm.common.bus.suspects import Suspects
from jouleswarm.common.wire.mqtt import PUBLISH, publish_head

logger = logging.getLogger("bus")

SOCKET_BUFFER_BYTES = 4 * 1024 * 1024
_DISCONNECT = 0xE0
_INCARNATION = re.compile(r"\.[0-9a-f]{8}$")

OnTransfer = Callable[[str, int, int], None]


def wire_id(name: str) -> str:
    """MQTT client id of a new incarnation of the client called `name`: unique, so that none is taken over."""
    return f"{name}.{secrets.token_hex(4)}"


def name_of(client_id: str) -> str:
    """The name that the bytes of an MQTT client id are booked under; undoes `wire_id`."""
    return _INCARNATION.sub("", client_id)


class FastClient(ReadingClient):
    """paho's client with `recv_into` and gathered writes, which reads only what there is room for.

    Callbacks, all called in the network thread:
        on_sent(topic, payload_bytes, packet_bytes): a PUBLISH was written whole.
        on_received(topic, payload, retained, packet_bytes): a PUBLISH came in whole.
        has_room(): whether another packet may be read. While not, the broker is left to wait.
        on_not_taken(topic, packet_bytes): the broker closes each connection on which this message is sent.
        on_unreachable(error): a connection could not be made, or TLS failed; it is tried again unless this raises.
        on_failure(error): the network thread ends by this error.
    """

    on_sent: OnTransfer
    on_not_taken: Callable[[str, int], None]
    on_failure: Callable[[BaseException], None]

    def __init__(self, client_id: str) -> None:
        super().__init__(client_id)
        self._suspects = Suspects()

    # Sending

    def _send_publish(
        self,
        mid: int,
        topic: bytes,
        payload: bytes | bytearray = b"",
        qos: int = 0,
        retain: bool = False,
        dup: bool = False,
        info: paho.MQTTMessageInfo | None = None,
        properties: Properties | None = None,
    ) -> MQTTErrorCode:
        if not self.is_open:
            return MQTTErrorCode.MQTT_ERR_NO_CONN
        head = publish_head(topic, len(payload), qos, mid, dup=dup, retain=retain)
        packet: Any = _Parts(head, payload, topic)
        return self._packet_queue(PUBLISH, packet, mid, qos, info)

    def _packet_write(self) -> MQTTErrorCode:
        while self._out_packet:
            packet = self._out_packet[0]
            try:
                sent = self._send_some(packet["packet"], packet["pos"])
            except BlockingIOError:
                return MQTTErrorCode.MQTT_ERR_AGAIN
            except OSError:
                if isinstance(self._sock, ssl.SSLSocket):  # what came before the end may say why
                    self._packet_read()
                return MQTTErrorCode.MQTT_ERR_CONN_LOST
            self._progressed()
            if packet["pos"] == 0 and isinstance(parts := packet["packet"], _Parts):
                self._suspects.begun(packet["mid"] if packet["qos"] else parts.name, parts.name, len(parts))
            packet["pos"] += sent
            packet["to_process"] -= sent
            if packet["to_process"] == 0:
                self._out_packet.popleft()
                self._written(packet)
                if packet["command"] & 0xF0 == _DISCONNECT:
                    return MQTTErrorCode.MQTT_ERR_SUCCESS
        return MQTTErrorCode.MQTT_ERR_SUCCESS

    def _send_some(self, packet: Any, start: int) -> int:
        sock = self._sock
        if not isinstance(sock, socket.socket):
            raise ConnectionError("not connected")
        return sock.sendmsg(packet.rest(start) if isinstance(packet, _Parts) else [memoryview(packet)[start:]])

    def _written(self, packet: Any) -> None:
        if isinstance(parts := packet["packet"], _Parts):
            self.on_sent(parts.name, len(parts.payload), len(parts))
            self._suspects.written(packet["mid"] if packet["qos"] else parts.name, time.monotonic())
            if packet["qos"] == 0:
                self.on_settled(len(parts.payload))
        elif packet["command"] & 0xF0 == _DISCONNECT:
            self._do_on_disconnect(packet_from_broker=False, v1_rc=MQTTErrorCode.MQTT_ERR_SUCCESS)
            self._sock_close()
            if self._state == _ConnectionState.MQTT_CS_DISCONNECTING:
                self._state = _ConnectionState.MQTT_CS_DISCONNECTED

    def _do_on_publish(self, mid: int, reason_code: ReasonCode, properties: Properties) -> MQTTErrorCode:
        self._suspects.confirmed(mid)
        size = len(self._out_messages[mid].payload)
        result = super()._do_on_publish(mid, reason_code, properties)
        self.on_settled(size)
        return result

    def _payload_bytes(self, packet: object) -> int:
        return len(packet.payload) if isinstance(packet, _Parts) else 0

    def reconnect(self) -> MQTTErrorCode:
        self._suspects.connecting()
        return super().reconnect()

    def _loop_rc_handle(self, rc: MQTTErrorCode) -> MQTTErrorCode:
        was_closed = rc == MQTTErrorCode.MQTT_ERR_CONN_LOST and self._state == _ConnectionState.MQTT_CS_CONNECTED
        result = super()._loop_rc_handle(rc)
        if was_closed and (suspect := self._suspects.lost(time.monotonic())) is not None:
            self.on_not_taken(suspect.topic, suspect.packet_bytes)
        return result

    # Life

    # Progress on a large message is a sign of life. Without this, a message that takes longer than two keepalives
    # is never sent: the PINGREQ waits behind it, paho gives up, reconnects and sends it again.

    def _progressed(self) -> None:
        now_s = time.monotonic()
        with self._msgtime_mutex:
            self._last_msg_out = self._last_bytes_received = now_s
        if self._ping_t > 0:
            self._ping_t = now_s

    def rename(self, client_id: str) -> None:
        """Connect by another MQTT client id from the next time on: sessions are clean, nothing is left behind."""
        self._client_id = client_id.encode()

    def _create_socket(self) -> Any:
        try:
            sock = super()._create_socket()
        except OSError as error:
            self.on_unreachable(error)
            raise
        if isinstance(sock, socket.socket):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER_BYTES)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BUFFER_BYTES)
        return sock

    def _thread_main(self) -> None:
        try:
            super()._thread_main()
        except BaseException as error:  # noqa: BLE001 - raised again in the user's thread
            self.on_failure(error)


class _Parts:
    """A PUBLISH packet in paho's queue: header and payload side by side, never joined."""

    def __init__(self, header: bytes, payload: bytes | bytearray, topic: bytes) -> None:
        self.header, self.payload, self.name = header, memoryview(payload), topic.decode()

    def __len__(self) -> int:
        return len(self.header) + len(self.payload)

    def rest(self, start: int) -> list[memoryview]:
        head = len(self.header)
        if start < head:
            return [memoryview(self.header)[start:], self.payload]
        return [self.payload[start - head :]]
