"""What goes in and out of a socket in one turn of the event loop."""

from __future__ import annotations

import asyncio
import socket

import pytest

from jouleswarm.broker.inbound import PacketReader
from jouleswarm.broker.limits import OVERHEAD_BYTES, Budget, Limits, Turns
from jouleswarm.broker.outbound import PacketWriter
from jouleswarm.common.wire.mqtt import publish_head

PINGRESP = b"\xd0\x00"


def fail(reason: str) -> None:
    pytest.fail(reason)


class Told:
    """What the writer tells of a packet, in its order."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def going(self) -> None:
        self.calls.append("going")

    def stayed(self) -> None:
        self.calls.append("stayed")

    def ended(self, written: int) -> None:
        self.calls.append(f"ended {written}")


def packet_of(payload: bytes) -> bytes:
    return publish_head(b"t", len(payload), 1, 7) + payload


@pytest.mark.parametrize("sizes", [(40_000, 20, 40_000, 16_384, 0), (5, 6, 7), (200_000, 200_000)])
def test_packets_are_read_whole_and_in_order_however_they_lie_in_the_buffer(sizes):
    payloads = [bytes([index + 1]) * size for index, size in enumerate(sizes)]

    async def scenario() -> None:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            theirs.setblocking(False)
            budget = Budget(1 << 30)
            reader = PacketReader(ours, Limits(), budget, fail)
            data = b"".join(map(packet_of, payloads))
            sending = asyncio.create_task(asyncio.get_running_loop().sock_sendall(theirs, data))
            cost_bytes = 0
            for payload in payloads:
                await reader.begun()
                packet = reader.ready_packet() or await reader.read_packet()
                assert bytes(packet.body) == b"\0\1t\0\7" + payload
                cost_bytes += len(payload) + 5 + OVERHEAD_BYTES  # topic of 3 bytes, identifier of 2
            await sending
            assert budget.used_bytes == cost_bytes
            reader.end("done")

    asyncio.run(asyncio.wait_for(scenario(), 20))


def test_a_packet_is_not_ready_before_it_has_come_whole_or_without_room():
    async def scenario() -> None:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            budget = Budget(1000)
            reader = PacketReader(ours, Limits(), budget, fail)
            packet = packet_of(b"x" * 200)
            theirs.sendall(packet[:100])
            await reader.begun()
            assert reader.ready_packet() is None
            reading = asyncio.create_task(reader.read_packet())
            theirs.sendall(packet[100:] + packet)
            assert bytes((await reading).body)[5:] == b"x" * 200
            await reader.begun()
            assert reader.ready_packet() is None  # 717 bytes are taken for each, of 1000
            budget.release(717)
            assert reader.ready_packet() is not None or await reader.read_packet()
            reader.end("done")

    asyncio.run(asyncio.wait_for(scenario(), 20))


def test_small_packets_of_one_turn_go_out_in_one_call_and_before_a_connection_ends():
    async def scenario() -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)  # each call is a record of its own
        with ours, theirs:
            ours.setblocking(False)
            outcome = Told()
            writer = PacketWriter(ours, Turns(), fail)
            writer.send(PINGRESP)
            writer.send(b"head", memoryview(b"payload"), outcome)
            assert outcome.calls == []
            await asyncio.sleep(0)
            assert theirs.recv(100) == PINGRESP + b"headpayload"
            assert outcome.calls == ["going", "ended 11"]
            writer.send(PINGRESP)
            writer.end()
            assert theirs.recv(100) == PINGRESP

    asyncio.run(asyncio.wait_for(scenario(), 20))
