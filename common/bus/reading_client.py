"""The receiving half of the MQTT client: packets straight into place, and no more of them than there is room for."""

from __future__ import annotations

import contextlib
import logging
import select
import socket
import ssl
import time
from collections.abc import Callable

from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.exception import MalformedPacket

from jouleswarm.common.bus.backlog import BacklogClient
from jouleswarm.common.bus.refusals import TLS_ALERT, TlsAnswerError
from jouleswarm.common.wire.mqtt import PUBLISH, packet_bytes, read_publish

logger = logging.getLogger("bus")

PAUSE_S = 1.0  # between two looks whether there is room for what comes


class ReadingClient(BacklogClient):
    """paho's client with `recv_into`, which reads only what there is room for; callbacks as `FastClient` has them."""

    on_received: Callable[[str, memoryview, bool, int], None]
    has_room: Callable[[], bool]
    on_unreachable: Callable[[OSError], None]

    def __init__(self, client_id: str) -> None:
        super().__init__(client_id)
        self._header = bytearray()
        self._body: memoryview | None = None
        self._got = 0

    def reconnect(self) -> MQTTErrorCode:
        self._header.clear()
        self._body = None
        return super().reconnect()

    def _packet_read(self) -> MQTTErrorCode:
        if self._body is None and not self._header and self.is_open and not self._finds_room():
            return MQTTErrorCode.MQTT_ERR_AGAIN
        try:
            if (self._body is None and not self._read_fixed_header()) or not self._read_body():
                return MQTTErrorCode.MQTT_ERR_CONN_LOST
        except BlockingIOError:
            return MQTTErrorCode.MQTT_ERR_AGAIN
        except OSError as error:
            if isinstance(error, ssl.SSLError | TlsAnswerError):
                self.on_unreachable(error)
            return MQTTErrorCode.MQTT_ERR_CONN_LOST
        except MalformedPacket:
            return MQTTErrorCode.MQTT_ERR_PROTOCOL
        assert self._body is not None
        first, body = self._header[0], self._body
        self._header.clear()
        self._body = None
        try:
            return self._handle(first, body)
        except MalformedPacket:
            return MQTTErrorCode.MQTT_ERR_PROTOCOL

    def _finds_room(self) -> bool:
        """Wait a moment for room to read on, or until there is something to write."""
        if self.has_room():
            return True
        self._heard()  # no answer is overdue that nobody listens for; PINGREQs go on
        sock, wake = self._sock, [] if self._sockpairR is None else [self._sockpairR]
        select.select(wake, [sock] if self._out_packet and isinstance(sock, socket.socket) else [], [], PAUSE_S)
        return self.has_room()

    def look_again(self) -> None:
        """There may be room now. From any thread."""
        if self._sockpairW is not None:
            with contextlib.suppress(BlockingIOError):  # it has been told already
                self._sockpairW.send(b"0")

    def _read_fixed_header(self) -> bool:
        header = self._header
        while len(header) < 2 or header[-1] >= 128:
            if len(header) == 5:
                raise MalformedPacket("remaining length of more than four bytes")
            byte = self._sock_recv(1)
            if not byte:
                return False
            header += byte
        if header[:2] == TLS_ALERT:
            raise TlsAnswerError("got a TLS alert, expected MQTT")
        length = sum((digit & 127) << 7 * place for place, digit in enumerate(header[1:]))
        self._body, self._got = memoryview(bytearray(length)), 0
        self._heard()
        return True

    def _read_body(self) -> bool:
        body, sock = self._body, self._sock
        assert body is not None
        while self._got < len(body):
            if not isinstance(sock, socket.socket):
                return False
            count = sock.recv_into(body[self._got :])
            if count == 0:
                return False
            self._got += count
            self._heard()
        return True

    def _handle(self, first: int, body: memoryview) -> MQTTErrorCode:
        if first & 0xF0 != PUBLISH:
            self._in_packet["command"] = first
            self._in_packet["packet"] = bytearray(body)
            self._in_packet["remaining_length"] = len(body)
            return self._packet_handle()
        try:
            topic, packet_id, payload = read_publish(first, body)
        except ValueError:
            return MQTTErrorCode.MQTT_ERR_PROTOCOL
        if first & 4:  # QoS 2, which nothing here subscribes at
            return MQTTErrorCode.MQTT_ERR_PROTOCOL
        try:
            name = topic.decode()
        except UnicodeDecodeError:
            logger.warning("ignored a message whose topic is not UTF-8: %r", topic)
        else:
            self.on_received(name, payload.toreadonly(), bool(first & 1), packet_bytes(len(body)))
        if packet_id:
            return self._send_puback(int.from_bytes(packet_id, "big"))
        return MQTTErrorCode.MQTT_ERR_SUCCESS

    def _heard(self) -> None:
        # Not a word from this client: the broker still waits for its PINGREQ.
        with self._msgtime_mutex:
            self._last_bytes_received = time.monotonic()
        self._ping_t = 0.0
