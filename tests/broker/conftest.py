"""A real broker process for each test that wants one, and a client that speaks raw MQTT."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import ssl
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.wire.mqtt import length_bytes

ROOT = Path(__file__).parents[2]
DEADLINE_S = 20.0


@dataclass
class BrokerProcess:
    process: subprocess.Popen[str]
    url: str
    metrics: str

    @property
    def port(self) -> int:
        return int(self.url.rpartition(":")[2])

    def scrape(self) -> dict[str, float]:
        """Prometheus samples: `name{labels}` -> value."""
        with urllib.request.urlopen(self.metrics, timeout=DEADLINE_S) as answer:
            lines = [line for line in answer.read().decode().splitlines() if not line.startswith("#")]
        return {name: float(value) for name, _, value in (line.rpartition(" ") for line in lines)}

    def event(self, name: str) -> float:
        return self.scrape().get(f'jouleswarm_broker_events_total{{event="{name}"}}', 0.0)

    def counted(self, name: str, times: float) -> None:
        """A client may see its connection closed before the broker has counted why."""
        wait_until(lambda: self.event(name) >= times, f"{name} counted {times} times")
        assert self.event(name) == times, name


def text(value: str) -> bytes:
    return len(value.encode()).to_bytes(2, "big") + value.encode()


class RawClient:
    """MQTT 3.1.1 by hand, for what a well-behaved client library would not do."""

    def __init__(self, port: int, tls: ssl.SSLContext | None = None, source: str = "127.0.0.1") -> None:
        self.present = 0  # what CONNACK said of a session
        self.sock = socket.create_connection(("127.0.0.1", port), timeout=DEADLINE_S, source_address=(source, 0))
        if tls is not None:
            self.sock = tls.wrap_socket(self.sock, server_hostname="127.0.0.1")

    def send(self, first: int, body: bytes = b"") -> None:
        self.sock.sendall(bytes([first]) + length_bytes(len(body)) + body)

    def connect(
        self, client_id: str, *, clean: bool = True, keepalive_s: int = 0, will: tuple[str, bytes] | None = None,
        will_flags: int = 0, login: tuple[str, str] | None = None, code: int = 0,
    ) -> int:  # fmt: skip
        """Returns session-present; `code` is the CONNACK's that is expected."""
        flags = (2 if clean else 0) | (4 if will else 0) | will_flags | (0xC0 if login else 0)
        body = text("MQTT") + bytes([4, flags]) + keepalive_s.to_bytes(2, "big") + text(client_id)
        if will is not None:
            body += text(will[0]) + len(will[1]).to_bytes(2, "big") + will[1]
        for each in login or ():
            body += text(each)
        self.send(0x10, body)
        first, answer = self.read()
        assert (first, answer[1]) == (0x20, code)
        return answer[0]

    def log_in(self, user: str, password: str) -> int:
        """Returns the code of CONNACK."""
        self.send(0x10, text("MQTT") + b"\x04\xc2\x00\x00" + text(user) + text(user) + text(password))
        return self.read()[1][1]

    def subscribe(self, topic_filter: str, qos: int = 1) -> int:
        """Returns the granted QoS."""
        self.send(0x82, b"\x00\x01" + text(topic_filter) + bytes([qos]))
        first, answer = self.read()
        assert (first, answer[:2]) == (0x90, b"\x00\x01")
        return answer[2]

    def publish(self, topic: str, payload: bytes, qos: int = 0, *, retain: bool = False) -> None:
        """At QoS 1 waits for the PUBACK."""
        self.send(0x30 | qos << 1 | retain, text(topic) + (b"\x00\x07" if qos else b"") + payload)
        if qos:
            assert self.read() == (0x40, b"\x00\x07")

    def read(self) -> tuple[int, bytes]:
        first = self._exactly(1)[0]
        length = shift = 0
        while True:
            digit = self._exactly(1)[0]
            length |= (digit & 127) << shift
            shift += 7
            if digit < 128:
                return first, self._exactly(length)

    def read_publish(self) -> tuple[int, str, bytes, bytes]:
        """(first byte, topic, packet identifier, payload)."""
        first, body = self.read()
        assert first >> 4 == 3, f"expected PUBLISH, got first byte 0x{first:02x}"
        end = 2 + int.from_bytes(body[:2], "big")
        start = end + (2 if first & 6 else 0)
        return first, body[2:end].decode(), body[end:start], body[start:]

    def ping(self) -> None:
        """Returns when the answer has come; nothing else may have come before it."""
        self.send(0xC0)
        assert self.read() == (0xD0, b"")

    def is_closed_by_broker(self, within_s: float = DEADLINE_S) -> bool:
        """Waits for the end of the stream, dropping what still comes."""
        deadline_s = time.monotonic() + within_s
        while (left_s := deadline_s - time.monotonic()) > 0:
            if select.select([self.sock], [], [], left_s)[0]:
                try:
                    if not self.sock.recv(65536):
                        return True
                except ConnectionResetError:
                    return True
        return False

    def close(self) -> None:
        self.sock.close()

    def _exactly(self, count: int) -> bytes:
        data = bytearray()
        while len(data) < count:
            part = self.sock.recv(count - len(data))
            assert part, "the broker closed the connection"
            data += part
        return bytes(data)


@contextlib.contextmanager
def broker_process(*options: str, stderr: int | None = None) -> Iterator[BrokerProcess]:
    """A broker on free ports, with any further options; it ends cleanly with the context. `stderr`: as of Popen."""
    command = [
        sys.executable,
        "-m",
        "jouleswarm.broker",
        "--port",
        "0",
        "--metrics-port",
        "0",
        "--exit-with-stdin",
        *options,
    ]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, stderr=stderr, text=True)
    assert process.stdin is not None
    assert process.stdout is not None
    ready = json.loads(process.stdout.readline())
    yield BrokerProcess(process, ready["url"], ready["metrics"])
    process.stdin.close()
    assert process.wait(timeout=DEADLINE_S) == 0
    process.stdout.close()
    if process.stderr is not None:
        process.stderr.close()


@pytest.fixture
def start_broker() -> Iterator[Callable[..., BrokerProcess]]:
    """Starts brokers; they end with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda *options, **more: stack.enter_context(broker_process(*options, **more))


@pytest.fixture
def broker(start_broker: Callable[..., BrokerProcess]) -> BrokerProcess:
    return start_broker()


@pytest.fixture
def guarded(start_broker: Callable[..., BrokerProcess], keys: Path) -> BrokerProcess:
    """A broker with the toy scenario's folder of keys."""
    return start_broker("--keys", str(keys))


@pytest.fixture
def raw() -> Iterator[Callable[..., RawClient]]:
    clients: list[RawClient] = []

    def connect(broker: BrokerProcess, tls: ssl.SSLContext | None = None, source: str = "127.0.0.1") -> RawClient:
        clients.append(RawClient(broker.port, tls, source))
        return clients[-1]

    yield connect
    for client in clients:
        client.close()


@pytest.fixture
def bus() -> Iterator[Callable[..., MqttBus]]:
    """Connects buses; they are closed with the test."""
    buses: list[MqttBus] = []

    def connect(broker: BrokerProcess, client: str, **options: object) -> MqttBus:
        buses.append(MqttBus.connect(broker.url, client, **options))  # type: ignore[arg-type]
        return buses[-1]

    yield connect
    for each in buses:
        each.close()


def wait_until(condition: Callable[[], bool], what: str, within_s: float = DEADLINE_S) -> None:
    """Poll a condition of the broker process that has no event to wait for."""
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s, f"not within {within_s} s: {what}"
        time.sleep(0.02)


@pytest.fixture
def eventually() -> Callable[..., None]:
    return wait_until
