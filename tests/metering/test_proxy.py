"""The proxy before a broker made up in the test."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from jouleswarm.common.bus.address import BrokerAddress, parse_url
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.tally import Tally
from jouleswarm.fleet.certificates import Validity, make_ca, make_server
from jouleswarm.metering.proxy import Proxy, client_tls, server_tls, without_user
from jouleswarm.metering.serve import parse_listen
from tests.metering.packets import connect, packet, publish

Serve = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]
CONNACK = packet(0x20, b"\0\0")


@contextlib.asynccontextmanager
async def before(serve: Serve, tls: ssl.SSLContext | None = None) -> AsyncIterator[tuple[Proxy, int]]:
    """A proxy before a broker that serves so; its port."""
    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    proxy = Proxy(BrokerAddress("127.0.0.1", server.sockets[0].getsockname()[1]), Tally(), tls)
    async with server, proxy.listening("127.0.0.1", 0) as port:
        yield proxy, port


async def ended(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """All is sent and passed on."""
    writer.write_eof()
    await reader.read()
    writer.close()


@pytest.mark.parametrize(
    "sent", [connect("r") + publish("a", b"1") + b"\x00spoilt\xff" * 100_000, b"GET / HTTP/1.1\r\n\r\n", b"\x10"]
)
def test_whatever_is_sent_reaches_the_broker_as_it_was_and_its_answer_comes_back(sent: bytes) -> None:
    heard = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        heard.append(await reader.read())  # to the end, which is passed on too
        writer.write(CONNACK + b"\x00answer")
        writer.close()

    async def body() -> tuple[bytes, Tally]:
        async with before(serve) as (proxy, port):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(sent)
            writer.write_eof()
            answer = await reader.read()
            writer.close()
        return answer, proxy.tally

    answer, tally = asyncio.run(body())
    assert (heard, answer) == ([sent], CONNACK + b"\x00answer")
    counted = dict.fromkeys(("in", "out"), 0)
    for (_, _, what), (_, _, packet_bytes) in tally.counts().items():
        counted[what.split()[0]] += packet_bytes
    assert counted == {"in": len(sent), "out": len(answer)}


def test_a_side_that_reads_nothing_holds_up_the_other_and_neither_the_memory_nor_others() -> None:
    slow_sent, quick_sent = connect("r") + publish("a", b"s" * (64 << 20)), b"q" * (1 << 20)

    async def body() -> list[bytes]:
        reading, heard = asyncio.Event(), list[bytes]()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            heard.append(await reader.readexactly(1))
            place = len(heard) - 1
            if heard[place] != b"q":
                await reading.wait()
            heard[place] += await reader.read()
            writer.close()

        async with before(serve) as (proxy, port):
            slow_reader, slow = await asyncio.open_connection("127.0.0.1", port)
            slow.write(slow_sent)
            while not proxy.clients or not (client := next(iter(proxy.clients))).other:
                await asyncio.sleep(0)
            while client.transport.is_reading():
                await asyncio.sleep(0)
            assert client.other.transport.get_write_buffer_size() <= 512 * 1024
            quick_reader, quick = await asyncio.open_connection("127.0.0.1", port)
            quick.write(quick_sent)
            await ended(quick_reader, quick)
            reading.set()
            await ended(slow_reader, slow)
        assert proxy.tally.counts()["r", "a", "in publish"][1] == 64 << 20
        return heard

    assert asyncio.run(body()) == [slow_sent, quick_sent]


def test_a_broker_that_is_not_there_ends_the_clients_connection() -> None:
    async def body() -> bytes:
        server = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        server.close()
        async with Proxy(BrokerAddress("127.0.0.1", port), Tally()).listening("127.0.0.1", 0) as listens:
            reader, writer = await asyncio.open_connection("127.0.0.1", listens)
            writer.close()
            return await reader.read()

    with contextlib.suppress(ConnectionResetError):
        assert asyncio.run(body()) == b""


def test_tls_ends_at_the_proxy_and_may_begin_again_there(tmp_path: Path) -> None:
    validity = Validity.days_from(datetime.datetime.now(datetime.UTC), 1)
    ca = make_ca("test", validity)
    shown = make_server(ca, ["127.0.0.1"], validity)
    paths = {name: tmp_path / name for name in ("ca.crt", "server.crt", "server.key")}
    for path, pem in zip(paths.values(), (ca.certificate_pem, shown.certificate_pem, shown.key_pem), strict=True):
        path.write_bytes(pem)
    tls = server_tls(paths["server.crt"], paths["server.key"])
    trusting = client_tls(BrokerAddress("127.0.0.1", 1, tls=True), paths["ca.crt"])
    sent = connect("r") + publish("a", bytes(1_000_000))

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(CONNACK + await reader.readexactly(len(sent)))
        writer.close()

    async def body() -> tuple[bytes, Tally]:
        broker = await asyncio.start_server(serve, "127.0.0.1", 0, ssl=tls)
        port = broker.sockets[0].getsockname()[1]
        proxy = Proxy(BrokerAddress("127.0.0.1", port), Tally(), tls, trusting)
        async with broker, proxy.listening("127.0.0.1", 0) as listens:
            reader, writer = await asyncio.open_connection("127.0.0.1", listens, ssl=trusting)
            writer.write(sent)
            return await reader.read(), proxy.tally

    answer, tally = asyncio.run(body())
    assert answer == CONNACK + sent
    assert tally.counts()["r", "a", "in publish"][1] == 1_000_000


def test_what_can_not_be_listened_on_is_one_line(tmp_path: Path) -> None:
    assert parse_listen(":1884") == (None, 1884)
    assert parse_listen("[::1]:5") == ("::1", 5)
    for wrong in ("1884", "a:b", "a:99999", "mqtt://a:1"):
        with pytest.raises(ConfigurationError, match="expected HOST:PORT"):
            parse_listen(wrong)
    with pytest.raises(ConfigurationError, match="expected --cert FILE and --key FILE"):
        server_tls(tmp_path / "c.pem", None)
    with pytest.raises(ConfigurationError, match="clients log in themselves"):
        without_user(parse_url("mqtt://me:secret@host"))

    async def taken() -> None:
        proxy = Proxy(BrokerAddress("127.0.0.1", 1), Tally())
        async with proxy.listening("127.0.0.1", 0) as port, proxy.listening("127.0.0.1", port):
            pass

    with pytest.raises(ConfigurationError, match="cannot listen on"):
        asyncio.run(taken())
