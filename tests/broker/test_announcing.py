"""What a broker that is killed has counted: never less than its clients can have received."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from amqtt.session import Session

from jouleswarm.broker.limits import Turns
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.broker.outbound import PacketWriter
from jouleswarm.broker.outcome import DeliveryOutcome
from jouleswarm.broker.publication import Publication
from jouleswarm.common.meter.meter import read_rows

TOPIC = "jouleswarm/run/maml/sl/1/1/weights"
PAYLOAD = bytes(100)
PACKET_BYTES = 1 + 2 + 2 + len(TOPIC) + 100  # type, length above 127, the topic with its length; QoS 0


class Kernel:
    """A socket that takes so many bytes of each system call, and looks at the counters' file in between."""

    def __init__(self, sock: socket.socket, takes: Sequence[int], folder: Path) -> None:
        self._sock, self._takes, self._folder = sock, list(takes), folder
        self.killed_here: list[int] = []
        """Messages that would have been counted as delivered by a kill after each system call."""

    def fileno(self) -> int:
        return self._sock.fileno()

    def sendmsg(self, views: Sequence[bytes | memoryview]) -> int:
        self.killed_here.append(delivered(self._folder))
        takes = self._takes.pop(0)
        if not takes:
            raise BlockingIOError
        return self._sock.send(b"".join(views)[:takes])


def delivered(folder: Path) -> int:
    return sum(row.messages for row in read_rows("broker", folder) if row.direction == "out")


def written(folder: Path, takes: Sequence[int], messages: int) -> tuple[list[int], list[int]]:
    """For each system call, what a kill in it would leave in the file, and what the meter tells after it."""

    async def scenario() -> tuple[list[int], list[int]]:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            meter = BrokerMeter(folder=folder)
            kernel: Any = Kernel(ours, takes, folder)
            writer = PacketWriter(kernel, Turns(), print)
            session = Session()
            session.client_id = "agent-1"
            for _ in range(messages):
                publication = Publication(TOPIC, memoryview(PAYLOAD), 0)
                header = publication.header(0, 0, dup=False, retain=False)
                outcome = DeliveryOutcome(meter, session, publication, None, len(header), False)
                writer.send(header, publication.payload, outcome)
            told = []
            for _ in takes:
                writer._flush()
                told.append(sum(row.messages for row in meter.rows()))
                assert delivered(folder) == told[-1]
            writer.end()
            return kernel.killed_here, told

    return asyncio.run(asyncio.wait_for(scenario(), 20))


def test_a_packet_given_to_the_kernel_is_counted_before_anybody_can_have_it(tmp_path: Path) -> None:
    assert written(tmp_path, [3 * PACKET_BYTES], 3) == ([3], [3])


def test_what_the_kernel_did_not_take_is_counted_when_it_does(tmp_path: Path) -> None:
    size = PACKET_BYTES
    takes = [2 * size + 5, 0, size - 5, size]
    # Four packets: two and a bit, nothing, the rest of the third, the fourth.
    assert written(tmp_path, takes, 4) == ([4, 4, 4, 4], [2, 2, 3, 4])


def test_a_packet_that_is_written_in_slices_is_counted_with_its_last(tmp_path: Path) -> None:
    async def scenario() -> None:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            meter, turns = BrokerMeter(folder=tmp_path), Turns()
            payload = bytes(turns.slice_bytes + 1000)
            publication = Publication(TOPIC, memoryview(payload), 0)
            header = publication.header(0, 0, dup=False, retain=False)
            kernel: Any = Kernel(ours, [len(header) + turns.slice_bytes - 7, 0, 7, 1000], tmp_path)
            kernel._sock = Sink(ours)
            writer = PacketWriter(kernel, turns, print)
            session = Session()
            session.client_id = "agent-1"
            outcome = DeliveryOutcome(meter, session, publication, None, len(header), False)
            writer.send(header, publication.payload, outcome)
            for _ in range(3):
                writer._flush()
            # The first slice is not the whole packet; then 1007 bytes are left, which are.
            assert kernel.killed_here == [0, 1, 1, 1]
            assert delivered(tmp_path) == 1
            writer.end()

    asyncio.run(asyncio.wait_for(scenario(), 20))


class Sink:
    """A socket that takes whatever it is given."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock

    def fileno(self) -> int:
        return self._sock.fileno()

    def send(self, data: bytes) -> int:
        return len(data)
