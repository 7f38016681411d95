"""Passes connections on to a broker, byte by byte and both ways, and counts beside it what passes."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import resource
import ssl
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from jouleswarm.common.bus.address import BrokerAddress
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.tally import Tally
from jouleswarm.metering.stream import Connection, Stream

log = logging.getLogger("jouleswarm.metering")

_READ_BYTES = 512 * 1024
"""At most at a time. What one side can't take of them waits, and nothing more is read from the other meanwhile."""
_CONNECT_S = 10.0
_END_S = 1.0


class _Room:
    """What all connections read into, one after the other."""

    def __init__(self) -> None:
        self.view = memoryview(bytearray(_READ_BYTES))

    def renew(self) -> None:
        """Leave what has been read to whom it waits for."""
        self.view = memoryview(bytearray(_READ_BYTES))


class _Side(asyncio.BufferedProtocol):
    """One side of a connection. What it receives goes to the other side; what it can't send yet holds that one up."""

    def __init__(self, stream: Stream, room: _Room) -> None:
        self._stream, self._room = stream, room
        self._transport: asyncio.Transport | None = None
        self.other: _Side | None = None
        self.is_gone = False
        self.early = b""
        """What came before there was another side: one read at most, which some event loops make."""

    @property
    def transport(self) -> asyncio.Transport:
        """Once it is connected."""
        assert self._transport is not None
        return self._transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        self._transport.set_write_buffer_limits(1, 0)

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._room.view

    def buffer_updated(self, nbytes: int) -> None:
        if self.other is None:
            self.early += self._room.view[:nbytes]
        else:
            self._pass_on(self._room.view[:nbytes])

    def _pass_on(self, data: bytes | memoryview) -> None:
        """Send first, count then."""
        assert self.other is not None
        transport = self.other.transport
        transport.write(data)
        if transport.get_write_buffer_size():
            self._room.renew()  # the transport may hold on to it
        self._stream.feed(data)

    def eof_received(self) -> bool:
        """The other way stays open where that can be; TLS ends both."""
        if self.other is None or not self.other.transport.can_write_eof():
            return False
        self.other.transport.write_eof()
        return True

    def pause_writing(self) -> None:
        if self.other is not None and not self.other.is_gone:
            self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        if self.other is not None and not self.other.is_gone:
            self.other.transport.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        self.is_gone = True
        if self.other is not None and not self.other.is_gone:
            self.other.transport.close()  # once what waits is sent


class _Client(_Side):
    """The side of a client, which connects to the broker before anything is read from it."""

    def __init__(self, proxy: Proxy) -> None:
        self._proxy, self._connection = proxy, Connection(proxy.tally)
        super().__init__(self._connection.sent, proxy.room)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.transport.pause_reading()
        self._proxy.clients.add(self)
        self._reaching = asyncio.get_running_loop().create_task(self._reach())

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._reaching.cancel()
        self._forget()

    async def _reach(self) -> None:
        proxy, loop = self._proxy, asyncio.get_running_loop()
        broker = _Broker(self, self._connection.received, proxy.room)
        try:
            async with asyncio.timeout(_CONNECT_S):
                await loop.create_connection(lambda: broker, proxy.broker.host, proxy.broker.port, ssl=proxy.broker_tls)
        except OSError as error:  # a TimeoutError is one
            log.warning("no connection to %s: %s", proxy.broker, error or f"none within {_CONNECT_S:g} s")
            self.transport.abort()
            return
        if self.is_gone:
            broker.transport.abort()
        else:
            self.other = broker
            self._pass_on(self.early)
            self.early = b""
            self.transport.resume_reading()

    def _forget(self) -> None:
        """Both sides are gone, or one never was."""
        if self.other is None or self.other.is_gone:
            self._connection.end()
            self._proxy.clients.discard(self)


class _Broker(_Side):
    """The side of the broker."""

    def __init__(self, client: _Client, stream: Stream, room: _Room) -> None:
        super().__init__(stream, room)
        self.other: _Client | None = client

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        assert self.other is not None
        if self.other.is_gone:
            self.other._forget()


@dataclass
class Proxy:
    """What all connections share."""

    broker: BrokerAddress
    tally: Tally
    tls: ssl.SSLContext | None = None
    """To be shown to clients."""
    broker_tls: ssl.SSLContext | None = None

    def __post_init__(self) -> None:
        self.clients: set[_Client] = set()
        self.room = _Room()

    @contextlib.asynccontextmanager
    async def listening(self, host: str | None, port: int) -> AsyncIterator[int]:
        """Pass connections on until the end; gives the port.

        Raises:
            ConfigurationError: it can't be listened on.
        """
        _allow_files()
        try:
            loop = asyncio.get_running_loop()
            server = await loop.create_server(lambda: _Client(self), host, port, ssl=self.tls, backlog=1024)
        except OSError as error:
            raise ConfigurationError(f"cannot listen on {host or ''}:{port}: {error.strerror or error}") from error
        try:
            yield int(server.sockets[0].getsockname()[1])
        finally:
            server.close()
            for client in list(self.clients):
                client.transport.abort()
                if client.other is not None:
                    client.other.transport.abort()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_END_S):
                    while self.clients:  # so that all that passed is counted
                        await asyncio.sleep(0)


def without_user(broker: BrokerAddress) -> BrokerAddress:
    """The address itself.

    Raises:
        ConfigurationError: it names a user, whom nothing would log in.
    """
    if broker.user or broker.password:
        raise ConfigurationError(f"--to {broker} with a user: clients log in themselves, expected the URL without")
    return broker


def server_tls(certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    """TLS to show to clients, if there is a certificate.

    Raises:
        ConfigurationError: one of both alone, or a file that holds something else.
    """
    if certificate is None and key is None:
        return None
    if certificate is None or key is None:
        raise ConfigurationError("TLS for clients needs both, expected --cert FILE and --key FILE")
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        context.load_cert_chain(certificate, key)
    except OSError as error:  # ssl.SSLError is one
        raise ConfigurationError(f"cannot use {certificate} and {key} for TLS: {error.strerror or error}") from error
    return context


def client_tls(broker: BrokerAddress, ca: Path | None) -> ssl.SSLContext | None:
    """TLS towards a broker of mqtts://, trusted by `ca` or else by what the system trusts.

    Raises:
        ConfigurationError: the file holds something else.
    """
    if not broker.tls:
        return None
    try:
        return ssl.create_default_context(cafile=ca)
    except OSError as error:
        raise ConfigurationError(f"cannot trust {ca}: {error.strerror or error}") from error


def _allow_files() -> None:
    """Two sockets a client: as many as the system lets this process have."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
