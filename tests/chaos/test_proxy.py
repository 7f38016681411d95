"""The proxy that spoils connections: it passes bytes on unchanged until it is told otherwise."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Iterator

import pytest

from jouleswarm.chaos.proxy import Proxy, Slowness
from jouleswarm.common.errors import RunError

DEADLINE_S = 20.0
PAST_MARK = 200


class Line:
    """A client, the proxy, and a broker that is the test's."""

    def __init__(self, listener: socket.socket, proxy: Proxy) -> None:
        self.listener, self.proxy = listener, proxy
        self.ends: list[socket.socket] = []

    def connect(self) -> tuple[socket.socket, socket.socket]:
        """Both ends of a new connection: the client's and the broker's."""
        client = socket.create_connection(("127.0.0.1", int(self.proxy.url.rpartition(":")[2])), DEADLINE_S)
        broker, _ = self.listener.accept()
        broker.settimeout(DEADLINE_S)
        self.ends += [client, broker]
        return client, broker


@pytest.fixture
def line() -> Iterator[Line]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(DEADLINE_S)
        with Proxy(f"mqtt://127.0.0.1:{listener.getsockname()[1]}") as proxy:
            line = Line(listener, proxy)
            yield line
        for end in line.ends:
            end.close()


def exactly(end: socket.socket, size: int) -> bytes:
    got = b""
    while len(got) < size:
        part = end.recv(size - len(got))
        assert part, f"the connection ended after {len(got)} of {size} bytes"
        got += part
    return got


def until_cut(end: socket.socket) -> bytes:
    got = b""
    try:
        while part := end.recv(65_536):
            got += part
    except ConnectionError:
        pass  # a cut may be seen as a reset
    return got


def test_bytes_go_both_ways_unchanged(line: Line) -> None:
    client, broker = line.connect()
    other_client, other_broker = line.connect()
    there, back = bytes(range(256)) * 1000, bytes(reversed(range(256))) * 1000
    for sender, receiver, data in ((client, broker, there), (broker, client, back), (other_client, other_broker, back)):
        sender.sendall(data)
        assert exactly(receiver, len(data)) == data
    assert line.proxy.cuts == 0


@pytest.mark.parametrize("end", [0, 1], ids=["client", "broker"])
def test_when_one_end_goes_the_other_hears_it(line: Line, end: int) -> None:
    ends = line.connect()
    ends[end].close()
    assert until_cut(ends[1 - end]) == b""


def test_a_connection_is_cut_a_little_way_behind_the_mark_and_only_once(line: Line) -> None:
    client, broker = line.connect()
    line.proxy.cut_at(b"/weights")
    assert line.proxy.is_armed
    client.sendall(b"a/other" + bytes(1000))
    assert exactly(broker, 1007) == b"a/other" + bytes(1000)
    message = b"a/weights" + bytes(1000)
    client.sendall(message)
    got = until_cut(broker)
    assert message.startswith(got)
    assert len(got) <= 1 + PAST_MARK  # the mark begins at 1
    assert until_cut(client) == b""
    assert (line.proxy.cuts, line.proxy.is_armed) == (1, False)

    client, broker = line.connect()
    client.sendall(message)
    assert exactly(broker, len(message)) == message


def test_a_message_that_ends_at_the_mark_is_let_through(line: Line) -> None:
    client, broker = line.connect()
    line.proxy.cut_at(b"/weights")
    message = b"a/weights" + bytes(100)
    client.sendall(message)
    assert exactly(broker, len(message)) == message
    assert line.proxy.is_armed


def test_bad_links_lose_their_connections_until_they_are_good_again(line: Line) -> None:
    client, broker = line.connect()
    line.proxy.slow_down(Slowness(bytes_per_s=1e9, cut_odds=1))
    client.sendall(b"12345678")
    assert until_cut(broker) in (b"", b"1234")  # half of the chunk, unless the cut was seen as a reset
    assert until_cut(client) == b""
    assert line.proxy.cuts == 1
    line.proxy.slow_down(None)
    client, broker = line.connect()
    client.sendall(b"12345678")
    assert exactly(broker, 8) == b"12345678"


def test_slow_links_lose_nothing(line: Line) -> None:
    client, broker = line.connect()
    line.proxy.slow_down(Slowness(bytes_per_s=1e6, cut_odds=0))
    client.sendall(bytes(range(200)) * 100)
    assert exactly(broker, 20_000) == bytes(range(200)) * 100


def test_without_a_broker_a_connection_ends_at_once() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with (
        Proxy(f"mqtt://127.0.0.1:{port}") as proxy,
        socket.create_connection(("127.0.0.1", int(proxy.url.rpartition(":")[2])), DEADLINE_S) as client,
    ):
        assert until_cut(client) == b""


def test_a_proxy_that_cannot_listen_is_an_error_and_no_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    async def refuse(*_: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(asyncio, "start_server", refuse)
    with pytest.raises(RunError, match=r"the proxy before the broker cannot listen: .*Too many open files"):
        Proxy("mqtt://127.0.0.1:1").__enter__()
