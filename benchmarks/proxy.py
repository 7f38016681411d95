"""Mosquitto through the metering proxy, HAProxy and directly, in turn: 5.57 MB to 12 subscribers, and 1,000 clients.

    python -m benchmarks.proxy [--rounds 15] [--clients 1000] [--own-core]

Each of the clients sends 1 kB at QoS 1, and a round ends when all have their PUBACK; connecting is not measured.
The proxy is one process more, which wants a core: on a machine with fewer cores than processes that run, it shows.
HAProxy, if it is installed, passes bytes on and counts nothing: what one process more costs at least. With --own-core
clients and brokers keep to the machine's first core and each relay to the last.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import socket
import statistics
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import psutil

from benchmarks.broker_throughput import ROBOTS, RUN, WEIGHTS_BYTES, cpu_s, fan_out, measure
from benchmarks.harness import Running, in_turn, metered, mosquitto, parser, ratio, seconds
from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.wire.mqtt import publish_head

CONNECT_HEAD = b"\x00\x04MQTT\x04\x02\x00\x00"
CONNACK_BYTES = PUBACK_BYTES = 4
SMALL_BYTES = 1000
_HAPROXY = """\
global
  maxconn 4000
  nbthread 1
defaults
  mode tcp
  option splice-auto
  timeout connect 5s
  timeout client 5m
  timeout server 5m
listen relay
  bind 127.0.0.1:{port}
  server broker {broker}
"""


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


@contextlib.contextmanager
def haproxy(program: str, url: str) -> Iterator[Running]:
    """HAProxy before a broker, as it comes, in one thread."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with tempfile.NamedTemporaryFile("w", suffix=".cfg") as config:
        config.write(_HAPROXY.format(port=port, broker=url.removeprefix("mqtt://")))
        config.flush()
        process = subprocess.Popen([program, "-q", "-db", "-f", config.name], stderr=subprocess.DEVNULL, text=True)
        try:
            MqttBus.connect(f"mqtt://127.0.0.1:{port}", "probe").close()
            yield Running(f"mqtt://127.0.0.1:{port}", process)
        finally:
            process.terminate()
            process.wait(timeout=10)


@contextlib.contextmanager
def sides(*, own_core: bool) -> Iterator[dict[str, Running]]:
    """Each before a broker of its own: what is published on one is not to reach the subscribers of another."""
    cores = sorted(os.sched_getaffinity(0))
    program = shutil.which("haproxy") or shutil.which("haproxy", path="/usr/sbin")
    if own_core:
        os.sched_setaffinity(0, cores[:1])
    with contextlib.ExitStack() as stack:
        brokers = [stack.enter_context(mosquitto()) for _ in range(3 if program else 2)]
        found = {"directly": brokers[0], "meter proxy": stack.enter_context(metered(brokers[1].url))}
        if program:
            found["HAProxy"] = stack.enter_context(haproxy(program, brokers[2].url))
        for relay in list(found.values())[1:] if own_core else ():
            os.sched_setaffinity(relay.pid, cores[-1:])
        yield found


def show(what: str, found: Mapping[str, Running], run: Callable[[], Mapping[str, Sequence[float]]]) -> None:
    """Medians and their spread, what each is of a direct connection, and the processor time of a relay."""
    processes = {name: psutil.Process(side.pid) for name, side in found.items()}
    before_s = {name: cpu_s(process) for name, process in processes.items()}
    times = run()
    print(f"{what} (load {os.getloadavg()[0]:.1f})")
    for name, held in times.items():
        told = f"{statistics.median(held) * 1e3:7.1f} ms ({min(held) * 1e3:.1f} to {max(held) * 1e3:.1f})"
        cpu_ms = (cpu_s(processes[name]) - before_s[name]) / (len(held) + 1) * 1e3
        of = "the broker" if name == "directly" else "it"
        print(f"  {name:12} {told:30} {ratio(held, times['directly']):5.2f}x, CPU of {of} {cpu_ms:.1f} ms a round")


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=15)
    known.add_argument("--clients", type=int, default=1000)
    known.add_argument("--own-core", action="store_true", help="a core for clients and brokers, and one for the relay")
    options = known.parse_args()
    with sides(own_core=options.own_core) as found:
        urls, proxy = {name: side.url for name, side in found.items()}, psutil.Process(found["meter proxy"].pid)
        for subscribers in (1, ROBOTS):
            case = fan_out(1, WEIGHTS_BYTES, subscribers, f"5.57 MB to {subscribers}")
            show(case.name, found, partial(measure, case, urls, options.rounds))
        loop, before_bytes = asyncio.new_event_loop(), proxy.memory_info().rss
        crowds = {name: Crowd(loop, url, options.clients) for name, url in urls.items()}
        idle_kb = (proxy.memory_info().rss - before_bytes) / options.clients / 1024
        acts = {name: partial(Crowd.round_s, crowd) for name, crowd in crowds.items()}
        show(f"1 kB from each of {options.clients} clients", found, partial(in_turn, acts, options.rounds))
        print(f"memory of the proxy: {proxy.memory_info().rss / 2**20:.0f} MiB; {idle_kb:.1f} KiB an idle client")


if __name__ == "__main__":
    main()
