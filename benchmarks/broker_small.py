"""Small messages: 100 robots at 1 kB and QoS 1, each to one neighbour, embedded broker against Mosquitto in one run.

    python -m benchmarks.broker_small [--rounds 7] [--robots 100] [--size 1000] [--no-meter] [--state]

The clients are raw sockets in two processes (`light_clients`). At saturation each robot keeps a window of messages
under way; at a moderate load each publishes at a fixed rate. Delay is from before the publisher's system call to
after the subscriber's; p99 is over all messages of a round, and shown is the median of the rounds.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import statistics
import tempfile
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import psutil

from benchmarks.broker_throughput import RUN, cpu_s
from benchmarks.harness import embedded, mosquitto, parser, ratio, seconds
from benchmarks.light_clients import drive

PROCESSES = 2
ANSWER_S = 120


class Load(NamedTuple):
    """Messages of each robot in a round; how many are under way at once, or how often one is published."""

    name: str
    messages: int
    window: int = 0
    interval_s: float = 0.0


class Round(NamedTuple):
    """What one round came to."""

    seconds: float
    p50_ms: float
    p99_ms: float
    broker_us: float
    clients_us: float


def topic(number: int) -> str:
    """What a robot publishes on."""
    return f"{RUN}/sl/1/{number}/weights"


class Swarm:
    """Processes of robots on one broker."""

    def __init__(self, url: str, broker: psutil.Process, robots: int, size_bytes: int) -> None:
        context = multiprocessing.get_context("fork")
        self._robots, self._broker = robots, broker
        self._pipes: list[Connection] = []
        self._processes = []
        for first in range(PROCESSES):
            ours, theirs = context.Pipe()
            numbers = range(first, robots, PROCESSES)
            arguments = (url, numbers, robots, topic, size_bytes, theirs)
            process = context.Process(target=drive, args=arguments, daemon=True)
            process.start()
            self._pipes.append(ours)
            self._processes.append(process)
        self._answers()

    def round(self, load: Load) -> Round:
        """One round of all robots."""
        found: list[Any] = []
        before_s = cpu_s(self._broker)

        def act() -> None:
            for pipe in self._pipes:
                pipe.send(load[1:])
            found.extend(self._answers())

        took_s = seconds(act)
        broker_s = cpu_s(self._broker) - before_s
        delays = sorted(each / 1e6 for delays_ns, _ in found for each in delays_ns)
        messages = load.messages * self._robots
        assert len(delays) == messages
        clients_s = sum(used_s for _, used_s in found)
        p50, p99 = (delays[int(messages * share)] for share in (0.5, 0.99))
        return Round(took_s, p50, p99, broker_s / messages * 1e6, clients_s / messages * 1e6)

    def end(self) -> None:
        for pipe in self._pipes:
            pipe.send(None)
        for process in self._processes:
            process.join()

    def _answers(self) -> list[Any]:
        if not all(pipe.poll(ANSWER_S) for pipe in self._pipes):
            raise SystemExit(f"a client did not answer within {ANSWER_S} s")
        return [pipe.recv() for pipe in self._pipes]


def tell(load: Load, robots: int, found: dict[str, list[Round]]) -> None:
    """A line for each broker, and the ratios."""
    messages = load.messages * robots
    for name, rounds in found.items():
        columns = Round(*(statistics.median(column) for column in zip(*rounds, strict=True)))
        # Processor time goes by ticks of 10 ms: the mean over all rounds is finer than each.
        broker_us = statistics.mean(each.broker_us for each in rounds)
        print(
            f"{load.name:22}{name:>10}{messages / columns.seconds:8.0f} messages/s: p50 {columns.p50_ms:6.2f} ms, "
            f"p99 {columns.p99_ms:6.2f} ms; processor a message: broker {broker_us:.1f} us, "
            f"clients {columns.clients_us:.1f} us"
        )
    ours, theirs = found.values()
    faster = ratio([each.seconds for each in theirs], [each.seconds for each in ours])
    later = ratio([each.p99_ms for each in ours], [each.p99_ms for each in theirs])
    busier = statistics.mean(each.broker_us for each in ours) / statistics.mean(each.broker_us for each in theirs)
    ratios = f"throughput {faster:.2f}, p99 {later:.2f}, broker's processor time {busier:.2f}"
    print(f"{load.name:22}{'ratio':>10} {ratios}", flush=True)


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=7)
    known.add_argument("--robots", type=int, default=100)
    known.add_argument("--size", type=int, default=1000, help="payload, bytes")
    known.add_argument("--window", type=int, default=20, help="messages of a robot under way at saturation")
    known.add_argument("--rate", type=float, default=20.0, help="messages of a robot a second at the moderate load")
    known.add_argument("--no-meter", action="store_true", help="switch the embedded broker's metering off")
    known.add_argument("--state", action="store_true", help="have its counters outlive a kill, as those of a run do")
    options = known.parse_args()
    loads = (
        Load("saturation", 200, window=options.window),
        Load(f"{options.rate * options.robots:g} messages/s", int(options.rate * 2), interval_s=1 / options.rate),
    )
    with contextlib.ExitStack() as stack:
        own = ["--no-meter"] if options.no_meter else []
        if options.state:
            own += ["--state", stack.enter_context(tempfile.TemporaryDirectory())]
        brokers = {"embedded": stack.enter_context(embedded(*own))}
        brokers["mosquitto"] = stack.enter_context(mosquitto())
        swarms = {
            name: Swarm(broker.url, psutil.Process(broker.pid), options.robots, options.size)
            for name, broker in brokers.items()
        }
        for load in loads:
            act = {name: partial(swarm.round, load) for name, swarm in swarms.items()}
            found: dict[str, list[Round]] = {name: [] for name in act}
            for number in range(options.rounds + 1):
                for name in list(act)[:: 1 if number % 2 else -1]:
                    found[name].append(act[name]())
            tell(load, options.robots, {name: rounds[1:] for name, rounds in found.items()})
        for swarm in swarms.values():
            swarm.end()
        print(f"load of the machine: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
