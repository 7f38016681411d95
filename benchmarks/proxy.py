"""Mosquitto through the metering proxy and directly, in turn: 5.57 MB to 12 subscribers, and 1,000 clients at once.

    python -m benchmarks.proxy [--rounds 15] [--clients 1000]

Each of the clients sends 1 kB at QoS 1, and a round ends when all have their PUBACK; connecting is not measured.
The proxy is one process more, which wants a core: on a machine with fewer cores than processes that run, it shows.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial

import psutil

from benchmarks.broker_throughput import ROBOTS, RUN, WEIGHTS_BYTES, cpu_s, fan_out, measure
from benchmarks.harness import compare, in_turn, metered, mosquitto, parser, seconds
from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.wire.mqtt import publish_head

CONNECT_HEAD = b"\x00\x04MQTT\x04\x02\x00\x00"
CONNACK_BYTES = PUBACK_BYTES = 4
SMALL_BYTES = 1000


class Crowd:
    """Many clients that send at once."""

    def __init__(self, loop: asyncio.AbstractEventLoop, url: str, clients: int) -> None:
        self._loop = loop
        self._ends = loop.run_until_complete(self._connect(url, clients))

    def round_s(self) -> float:
        """Until all have their PUBACK."""
        return seconds(lambda: self._loop.run_until_complete(self._round()))

    async def _connect(self, url: str, clients: int) -> Sequence[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
        address, ends = parse_url(url), []
        for number in range(clients):
            reader, writer = await asyncio.open_connection(address.host, address.port)
            name = f"client-{number}".encode()
            body = CONNECT_HEAD + len(name).to_bytes(2, "big") + name
            writer.write(bytes((0x10, len(body))) + body)
            await reader.readexactly(CONNACK_BYTES)
            ends.append((reader, writer))
        return ends

    async def _round(self) -> None:
        packet = publish_head(f"{RUN}/ul/1/1/experience".encode(), SMALL_BYTES, 1, 1) + bytes(SMALL_BYTES)
        for _, writer in self._ends:
            writer.write(packet)
        await asyncio.gather(*(reader.readexactly(PUBACK_BYTES) for reader, _ in self._ends))


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=15)
    known.add_argument("--clients", type=int, default=1000)
    options = known.parse_args()
    # A broker each: what is published on one side is not to reach the subscribers of the other.
    with mosquitto() as broker, mosquitto() as behind, metered(behind.url) as proxy:
        urls, process = {"through the proxy": proxy.url, "directly": broker.url}, psutil.Process(proxy.pid)
        for subscribers in (1, ROBOTS):
            case = fan_out(1, WEIGHTS_BYTES, subscribers, f"5.57 MB to {subscribers}")
            before_s = cpu_s(process)
            found = measure(case, urls, options.rounds)
            each_ms = (cpu_s(process) - before_s) / (options.rounds + 1) * 1e3
            print(f"{compare(case.name, found)}; CPU of the proxy {each_ms:.1f} ms a round", flush=True)
        loop = asyncio.new_event_loop()
        crowds = {name: Crowd(loop, url, options.clients) for name, url in urls.items()}
        found = in_turn({name: partial(Crowd.round_s, crowd) for name, crowd in crowds.items()}, options.rounds)
        print(compare(f"1 kB from each of {options.clients} clients", found))
        print(f"memory of the proxy: {process.memory_info().rss / 2**20:.0f} MiB")


if __name__ == "__main__":
    main()
