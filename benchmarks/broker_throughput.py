"""Delivered throughput of the embedded broker against Mosquitto, with the same clients, in one run.

    python -m benchmarks.broker_throughput [--rounds 15] [--no-meter]

Every subscriber is a process of its own. Each round measures all brokers one after the other, so that a busy
machine slows all of them alike; the ratios are medians over the rounds. On a busy machine wall time jumps with
where the scheduler puts the processes, so the brokers' processor time a round is shown as well. In the case called raw
publisher and subscriber are plain sockets (`light_clients`), so that the clients' own cost hides less of the brokers'.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, wait
from typing import Any

import psutil

from benchmarks.harness import embedded, in_turn, mosquitto, parser, ratio, seconds
from benchmarks.light_clients import light_publisher, light_subscriber
from jouleswarm.common.bus.mqtt import MqttBus

WEIGHTS_BYTES = 5_565_072
FRAME_BYTES = 1_228_800
FRAMES = 20
ROBOTS = 12
PUBACK_BYTES = 4
RUN = "jouleswarm/bench/maml"


def subscriber(url: str, name: str, count: int, pipe: Connection) -> None:
    """Says so whenever `count` messages have come."""
    bus = MqttBus.connect(url, name)
    bus.subscribe(f"{RUN}/#")
    pipe.send("ready")
    while pipe.recv():
        for _ in range(count):
            bus.receive()
        pipe.send("done")
    bus.close()


def robot(url: str, number: int, pipe: Connection) -> None:
    """One round: frames up, weights to a neighbour, the neighbour's weights and the meta-model in."""
    bus = MqttBus.connect(url, f"agent-{number}")
    bus.subscribe(f"{RUN}/sl/{number ^ 1}/weights", f"{RUN}/dl/meta")
    frame, weights = os.urandom(FRAME_BYTES), os.urandom(WEIGHTS_BYTES)
    pipe.send("ready")
    while pipe.recv():
        for _ in range(FRAMES):
            bus.publish(f"{RUN}/ul/{number}/experience", frame)
        bus.publish(f"{RUN}/sl/{number}/weights", weights)
        for _ in range(2):
            bus.receive()
        pipe.send("done")
    bus.close()


def data_center(url: str, pipe: Connection) -> None:
    """One round: all frames in, the meta-model out."""
    bus = MqttBus.connect(url, "datacenter")
    bus.subscribe(f"{RUN}/ul/#")
    meta = os.urandom(WEIGHTS_BYTES)
    pipe.send("ready")
    while pipe.recv():
        for _ in range(ROBOTS * FRAMES):
            bus.receive()
        bus.publish(f"{RUN}/dl/meta", meta)
        bus.flush()
        pipe.send("done")
    bus.close()


def ring_robot(url: str, number: int, robots: int, pipe: Connection) -> None:
    """One round: weights to both neighbours of a ring, theirs in; in the end wire and payload bytes are told."""
    bus = MqttBus.connect(url, f"agent-{number}")
    neighbours = ((number + 1) % robots, (number - 1) % robots)
    bus.subscribe(*(f"{RUN}/sl/1/{neighbour}/weights" for neighbour in neighbours))
    weights = os.urandom(WEIGHTS_BYTES)
    pipe.send("ready")
    while pipe.recv():
        bus.publish(f"{RUN}/sl/1/{number}/weights", weights)
        for _ in neighbours:
            message = bus.receive()
            assert message is not None
            assert len(message.payload) == WEIGHTS_BYTES
        pipe.send("done")
    bus.close()
    rows = bus.meter.rows()
    wire_bytes = sum(row.packet_bytes + PUBACK_BYTES * row.messages for row in rows)
    pipe.send((wire_bytes, sum(row.payload_bytes for row in rows)))


class Crew:
    """Client processes that all do a round when told."""

    def __init__(self, jobs: list[tuple[Callable[..., None], tuple[Any, ...]]]) -> None:
        context = multiprocessing.get_context("fork")
        self._processes, self._pipes = [], []
        for job, arguments in jobs:
            ours, theirs = context.Pipe()
            process = context.Process(target=job, args=(*arguments, theirs), daemon=True)
            process.start()
            self._processes.append(process)
            self._pipes.append(ours)
        self._gather()

    def round_s(self, act: Callable[[], None]) -> float:
        for pipe in self._pipes:
            pipe.send(True)

        def whole_round() -> None:
            act()
            self._gather()

        return seconds(whole_round)

    def end(self, *, answers: bool = False) -> list[Any]:
        """End the clients; gives what each says last, if it does."""
        for pipe in self._pipes:
            pipe.send(False)
        last = [pipe.recv() for pipe in self._pipes] if answers else []
        for process in self._processes:
            process.join()
        return last

    def _gather(self) -> None:
        left = set(self._pipes)
        while left:
            for pipe in wait(list(left), timeout=90) or exit_with("a client did not answer within 90 s"):
                pipe.recv()
                left.discard(pipe)


def exit_with(message: str) -> Any:
    raise SystemExit(message)


@dataclass
class Case:
    """What one round delivers."""

    name: str
    delivered_bytes: int
    crew: Callable[[str], list[tuple[Callable[..., None], tuple[Any, ...]]]]
    messages: int = 0
    size_bytes: int = 0


def fan_out(messages: int, size_bytes: int, subscribers: int, name: str) -> Case:
    def crew(url: str) -> list[tuple[Callable[..., None], tuple[Any, ...]]]:
        return [(subscriber, (url, f"agent-{number}", messages)) for number in range(subscribers)]

    return Case(name, messages * size_bytes * subscribers, crew, messages, size_bytes)


def exchange_crew(url: str) -> list[tuple[Callable[..., None], tuple[Any, ...]]]:
    return [(data_center, (url,)), *((robot, (url, number)) for number in range(ROBOTS))]


def light_crew(url: str) -> list[tuple[Callable[..., None], tuple[Any, ...]]]:
    what = (url, f"{RUN}/ul/1/1/experience", FRAMES, FRAME_BYTES)
    return [(light_publisher, what), (light_subscriber, what)]


CASES = (
    fan_out(1, WEIGHTS_BYTES, 1, "5.57 MB to 1"),
    fan_out(1, WEIGHTS_BYTES, ROBOTS, "5.57 MB to 12"),
    fan_out(FRAMES, FRAME_BYTES, 1, "20 x 1.23 MB to 1"),
    Case("20 x 1.23 MB, raw", FRAMES * FRAME_BYTES, light_crew),
    Case("exchange of 12", ROBOTS * (FRAMES * FRAME_BYTES + 2 * WEIGHTS_BYTES), exchange_crew),
)


def measure(case: Case, urls: dict[str, str], rounds: int) -> dict[str, list[float]]:
    """Seconds of each round, per broker; the first round of each warms up and is left out."""
    crews = {name: Crew(case.crew(url)) for name, url in urls.items()}
    publishers = {name: MqttBus.connect(url, "publisher") for name, url in urls.items()}
    payload = os.urandom(case.size_bytes)

    def one_round(name: str) -> float:
        def act() -> None:
            for _ in range(case.messages):
                publishers[name].publish(f"{RUN}/ul/1/1/experience", payload)

        return crews[name].round_s(act)

    found = in_turn({name: partial(one_round, name) for name in urls}, rounds)
    for name in urls:
        crews[name].end()
        publishers[name].close()
    return found


def cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=15)
    known.add_argument("--no-meter", action="store_true", help="switch the embedded broker's metering off")
    known.add_argument("--case", help="only cases whose name contains this")
    options = known.parse_args()
    with contextlib.ExitStack() as stack:
        brokers = {"embedded": stack.enter_context(embedded(*(["--no-meter"] if options.no_meter else [])))}
        brokers["mosquitto"] = stack.enter_context(mosquitto())
        urls = {name: broker.url for name, broker in brokers.items()}
        processes = {name: psutil.Process(broker.pid) for name, broker in brokers.items()}
        print(
            f"{'case':20}"
            + "".join(f"{name + ', ms (MB/s)':>24}" for name in urls)
            + "      x as fast as   broker CPU, ms"
        )
        for case in CASES:
            if options.case and options.case not in case.name:
                continue
            rounds = max(3, options.rounds // 3) if case.crew is exchange_crew else options.rounds
            before_s = {name: cpu_s(process) for name, process in processes.items()}
            found = measure(case, urls, rounds)
            cpu_ms = [(cpu_s(processes[name]) - before_s[name]) / (rounds + 1) * 1e3 for name in urls]
            cells = (
                f"{statistics.median(each) * 1e3:12.1f} ({case.delivered_bytes / 1e6 / statistics.median(each):6.0f})"
                for each in found.values()
            )
            faster = f"{ratio(found['mosquitto'], found['embedded']):.2f} mosquitto"
            row = f"{case.name:20}" + "".join(f"{cell:>24}" for cell in cells) + f"{faster:>17}"
            print(row + "   " + " against ".join(f"{each:.1f}" for each in cpu_ms), flush=True)


if __name__ == "__main__":
    main()
