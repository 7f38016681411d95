"""TLS for the broker's connections."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jouleswarm.broker.errors import TlsFailed
from jouleswarm.broker.inbound import PacketReader
from jouleswarm.common.bus.tls import TlsSocket
from jouleswarm.common.errors import ConfigurationError

# A fatal alert, protocol_version, as a record by itself (RFC 8446, sections 5.1 and 6.2).
_PROTOCOL_VERSION = b"\x15\x03\x03\x00\x02\x02\x46"


@dataclass(frozen=True)
class TlsFiles:
    """PEM files. With a client CA, only clients with a certificate that it has signed are let in."""

    certificate: Path
    key: Path
    client_ca: Path | None = None

    def context(self) -> ssl.SSLContext:
        """TLS settings of the broker: TLS 1.3 only, so that nothing is renegotiated once bytes flow.

        Raises:
            ConfigurationError: a file is missing or holds something else.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        context.num_tickets = 0  # nobody resumes a session
        context.sslsocket_class = TlsSocket
        try:
            context.load_cert_chain(self.certificate, self.key)
            if self.client_ca is not None:
                context.load_verify_locations(self.client_ca)
                context.verify_mode = ssl.CERT_REQUIRED
        except OSError as error:  # ssl.SSLError is one
            raise ConfigurationError(
                f"cannot use {self.certificate}, {self.key} and {self.client_ca} for TLS: {error.strerror or error}; "
                "expected PEM files as `jouleswarm keys init` makes them"
            ) from error
        return context


class TlsPacketReader(PacketReader):
    """Knows that bytes can wait inside TLS, where the event loop does not see them."""

    async def _receive(self, targets: list[memoryview], wanted: int) -> int:
        if isinstance(self._sock, ssl.SSLSocket) and self._ended is None and self._sock.pending():
            self._loop.call_soon(self._on_pending)
        return await super()._receive(targets, wanted)

    def _read(self, targets: list[memoryview]) -> int:
        return self._sock.recv_into(targets[0])  # an SSLSocket cannot scatter

    def _on_pending(self) -> None:
        if self._ended is None:
            self._on_readable()


async def shake_hands(sock: ssl.SSLSocket) -> None:
    """The TLS handshake on a non-blocking socket.

    Raises:
        TlsFailed: the client does not speak TLS, or has no certificate that is taken here.
    """
    loop = asyncio.get_running_loop()
    while True:
        try:
            sock.do_handshake()
            return
        except ssl.SSLWantReadError:
            await _event(loop.add_reader, loop.remove_reader, sock)
        except ssl.SSLWantWriteError:
            await _event(loop.add_writer, loop.remove_writer, sock)
        except OSError as error:
            reason = error.reason if isinstance(error, ssl.SSLError) else error.strerror
            if reason == "WRONG_VERSION_NUMBER":
                _answer_plain(sock)
            raise TlsFailed(f"TLS handshake failed: {reason or error}") from error


def _answer_plain(sock: ssl.SSLSocket) -> None:
    """Tell a client that does not speak TLS what it has come to; OpenSSL says nothing to it."""
    with contextlib.suppress(OSError):
        socket.socket.recv(sock, 65536)  # with bytes left unread the close would overtake the answer
        socket.socket.send(sock, _PROTOCOL_VERSION)


async def _event(add: Callable[..., Any], remove: Callable[[Any], Any], sock: ssl.SSLSocket) -> None:
    ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    add(sock, _set, ready)
    try:
        await ready
    finally:
        remove(sock)


def _set(ready: asyncio.Future[None]) -> None:
    if not ready.done():
        ready.set_result(None)
