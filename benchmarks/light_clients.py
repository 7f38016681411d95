"""MQTT clients that cost little, so that a broker's work is what is seen: blocking sockets, packets made before.

They trust the broker: no keepalive, nothing is sent again, sizes are those of the one topic that they listen to.
"""

from __future__ import annotations

import os
import selectors
import socket
import time
from array import array
from collections.abc import Callable
from multiprocessing.connection import Connection

from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.wire.mqtt import length_bytes, publish_head

PUBACK = 0x40
_PUBACK = b"\x40\x02"
_STAMP_BYTES = 8
_READ_BYTES = 256 * 1024


def text(name: str) -> bytes:
    """A string with its length before it."""
    return len(name).to_bytes(2, "big") + name.encode()


def connect(url: str, name: str, *topics: str) -> socket.socket:
    """A socket on which a clean session is open, with subscriptions at QoS 1."""
    address = parse_url(url)
    sock = socket.create_connection((address.host, address.port))
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    body = text("MQTT") + b"\x04\x02\0\0" + text(name)
    sock.sendall(b"\x10" + length_bytes(len(body)) + body)
    assert take(sock, 4) == b"\x20\x02\0\0"
    for topic in topics:
        body = b"\0\1" + text(topic) + b"\1"
        sock.sendall(b"\x82" + length_bytes(len(body)) + body)
        assert take(sock, 5)[4] == 1
    return sock


def take(sock: socket.socket, count: int) -> bytearray:
    """The next bytes, however they come."""
    data = bytearray(count)
    take_into(sock, memoryview(data))
    return data


def take_into(sock: socket.socket, view: memoryview) -> None:
    """Fill `view` with the next bytes."""
    while view:
        count = sock.recv_into(view, len(view), socket.MSG_WAITALL)
        assert count, "the broker closed the connection"
        view = view[count:]


def light_publisher(url: str, topic: str, count: int, size_bytes: int, pipe: Connection) -> None:
    """A round: `count` messages at QoS 1, one behind the other, until all are acknowledged."""
    sock, payload = connect(url, "publisher"), os.urandom(size_bytes)
    head = publish_head(topic.encode(), size_bytes, 1, 1)
    pipe.send("ready")
    while pipe.recv():
        for _ in range(count):
            sock.sendall(head)
            sock.sendall(payload)
        take(sock, 4 * count)
        pipe.send("done")


def light_subscriber(url: str, topic: str, count: int, size_bytes: int, pipe: Connection) -> None:
    """A round: `count` messages, each acknowledged."""
    sock = connect(url, "subscriber", topic)
    view = memoryview(bytearray(len(publish_head(topic.encode(), size_bytes, 1, 1)) + size_bytes))
    id_at = len(view) - size_bytes - 2
    pipe.send("ready")
    while pipe.recv():
        for _ in range(count):
            take_into(sock, view)
            sock.sendall(_PUBACK + view[id_at : id_at + 2])
        pipe.send("done")


class Robot:
    """Publishes messages with the time in them, and takes those of the robot before it in a ring."""

    def __init__(self, url: str, number: int, robots: int, topic: Callable[[int], str], size_bytes: int) -> None:
        before = topic((number - 1) % robots)
        self.sock = connect(url, f"agent-{number}", before)
        self.number = number
        self.to_send = self.to_take = self.unacknowledged = 0
        self._head = publish_head(topic(number).encode(), size_bytes, 1, 1)[:-2]
        self._stamp_at = len(publish_head(before.encode(), size_bytes, 1, 1))
        self._size = self._stamp_at + size_bytes
        self._filler = os.urandom(size_bytes - _STAMP_BYTES)
        self._identifier = 0
        self._rest = b""

    @property
    def is_done(self) -> bool:
        """Whether all was sent, acknowledged and received."""
        return not (self.to_send or self.to_take or self.unacknowledged)

    def packets(self, count: int) -> bytes:
        """The next messages, made now; all that is left at most."""
        count = min(count, self.to_send)
        stamp, made = time.perf_counter_ns().to_bytes(_STAMP_BYTES, "big"), list[bytes]()
        for _ in range(count):
            self._identifier = self._identifier % 65535 + 1
            made += (self._head, self._identifier.to_bytes(2, "big"), stamp, self._filler)
        self.to_send -= count
        self.unacknowledged += count
        return b"".join(made)

    def take(self, delays_ns: array[int]) -> bytes:
        """Read what has come; gives the acknowledgements to send."""
        came = self.sock.recv(_READ_BYTES)
        assert came, "the broker closed the connection"
        data, at, answers, now_ns = self._rest + came, 0, bytearray(), time.perf_counter_ns()
        end, stamp_at = len(data), self._stamp_at
        while at < end:
            is_answer = data[at] == PUBACK
            size = 4 if is_answer else self._size
            if at + size > end:
                break
            if is_answer:
                self.unacknowledged -= 1
            else:
                start = at + stamp_at
                answers += _PUBACK + data[start - 2 : start]
                delays_ns.append(now_ns - int.from_bytes(data[start : start + _STAMP_BYTES], "big"))
                self.to_take -= 1
            at += size
        self._rest = data[at:]
        return bytes(answers)


def saturate(robots: list[Robot], watched: selectors.BaseSelector, window: int, delays_ns: array[int]) -> None:
    """Each robot keeps `window` messages under way until all have come."""
    for robot in robots:
        robot.sock.sendall(robot.packets(window))
    busy = set(robots)
    while busy:
        for key, _ in watched.select():
            robot = key.data
            answers = robot.take(delays_ns)
            # In bunches, as a client's own buffer makes them: a call for each would measure the client.
            more = robot.packets(window - robot.unacknowledged) if robot.unacknowledged <= window // 2 else b""
            if answers or more:
                robot.sock.sendall(answers + more)
            if robot.is_done:
                busy.discard(robot)


def pace(robots: list[Robot], watched: selectors.BaseSelector, interval_s: float, delays_ns: array[int]) -> None:
    """Each robot publishes once every `interval_s`, one after the other, until all have come."""
    due = [(index * interval_s / len(robots), robot) for index, robot in enumerate(robots)]
    due = [(at + turn * interval_s, robot) for turn in range(robots[0].to_send) for at, robot in due]
    begun_s, at, busy = time.perf_counter(), 0, set(robots)
    while busy:
        now_s = time.perf_counter() - begun_s
        while at < len(due) and due[at][0] <= now_s:
            due[at][1].sock.sendall(due[at][1].packets(1))
            at += 1
        wait_s = max(0.0, due[at][0] - now_s) if at < len(due) else None
        for key, _ in watched.select(wait_s):
            if answers := key.data.take(delays_ns):
                key.data.sock.sendall(answers)
            if key.data.is_done:
                busy.discard(key.data)


def drive(
    url: str, numbers: range, robots: int, topic: Callable[[int], str], size_bytes: int, pipe: Connection
) -> None:
    """A process of robots. Told (messages of each, window, interval), it answers with delays and processor seconds."""
    own = [Robot(url, number, robots, topic, size_bytes) for number in numbers]
    watched = selectors.DefaultSelector()
    for robot in own:
        watched.register(robot.sock, selectors.EVENT_READ, robot)
    pipe.send("ready")
    while told := pipe.recv():
        count, window, interval_s = told
        for robot in own:
            robot.to_send = robot.to_take = count
        delays_ns, begun_s = array("q"), time.process_time()
        if interval_s:
            pace(own, watched, interval_s, delays_ns)
        else:
            saturate(own, watched, window, delays_ns)
        pipe.send((delays_ns, time.process_time() - begun_s))
