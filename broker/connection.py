"""One client's TCP connection."""

from __future__ import annotations

import socket
import ssl

from amqtt.adapters import WriterAdapter

from jouleswarm.broker.inbound import PacketReader
from jouleswarm.broker.limits import Budget, Limits, Turns
from jouleswarm.broker.outbound import PacketWriter
from jouleswarm.broker.tls import TlsPacketReader, shake_hands

# The receive buffer is the kernel's to size (`tcp_rmem`): it grows with what comes, and publishers wait less often.
SEND_BUFFER_BYTES = 512 * 1024


class Connection(WriterAdapter):  # type: ignore[misc]
    """A non-blocking socket on the running event loop. amqtt writes its control packets through it too."""

    def __init__(self, sock: socket.socket, limits: Limits, budget: Budget, turns: Turns) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self.peer: tuple[str, int] = sock.getpeername()[:2]
        self.closed_because: str | None = None
        self._sock = sock
        reads = TlsPacketReader if isinstance(sock, ssl.SSLSocket) else PacketReader
        self.reader = reads(sock, limits, budget, self.abort)
        self.writer = PacketWriter(sock, turns, self.abort)
        self.send = self.writer.send

    async def open(self) -> None:
        """What comes before MQTT: the handshake, on a TLS socket.

        Raises:
            TlsFailed: it failed.
        """
        if isinstance(self._sock, ssl.SSLSocket):
            await shake_hands(self._sock)

    def overdue(self, now_s: float, stall_s: float) -> str | None:
        """Why this connection must be ended for making no progress for so long, if it must."""
        if self.closed_because is not None:
            return None
        return self.reader.overdue(now_s, stall_s) or self.writer.overdue(now_s, stall_s)

    @property
    def held_bytes(self) -> int:
        """What waits for this client to read it, and what it has not finished sending."""
        return self.writer.queued_bytes + self.reader.held_bytes

    def silent_for(self, now_s: float) -> float:
        """Seconds since anything came; 0 while the broker itself does not read."""
        if self.closed_because is not None or self.reader.waits_for_room:
            return 0.0
        return now_s - self.reader.last_received_s

    def abort(self, reason: str) -> None:
        """End the connection at once; what was not written is given up."""
        if self.closed_because is not None:
            return
        self.closed_because = reason
        self.reader.end(reason)
        self.writer.end()
        self._sock.close()

    # amqtt's writer interface

    def write(self, data: bytes) -> None:
        """Queue bytes for sending."""
        self.send(data)

    async def drain(self) -> None:
        """Control packets never wait for the peer."""

    def get_peer_info(self) -> tuple[str, int]:
        """Address and port of the client."""
        return self.peer

    def get_ssl_info(self) -> ssl.SSLSocket | None:
        """The TLS socket, which knows the client's certificate; None without TLS."""
        return self._sock if isinstance(self._sock, ssl.SSLSocket) else None

    async def close(self) -> None:
        """End the connection when all that is queued has been written."""
        self.writer.close_when_empty()
