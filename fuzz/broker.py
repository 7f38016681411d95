"""Broken clients against a real broker process, while an honest pair exchanges numbered messages through it.

    python -m fuzz.broker [--connections 100000] [--seed 1] [--at-once 48] [--minutes 10] [--proxy [mosquitto]]

The broker must live, answer, end whom it must end, come back to the file descriptors that it had, stay within
--rss-limit-mb and log no traceback; of the honest messages none may be lost, changed or out of order. Exit code 1
otherwise. Connections end with RST, so that the machine does not run out of ports. With --proxy all of them go through
a metering proxy, and it is the one that is looked at; Mosquitto behind it need not end whom the embedded broker must.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import random
import socket
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

import psutil

from benchmarks.harness import MEGABYTE, Running, embedded, metered, mosquitto, parser
from fuzz.honest_pair import HonestPair
from fuzz.hostile_packets import KINDS, Kind, connect
from jouleswarm.common.bus.address import parse_url

LIMITS = ("--max-retained-mb", "8", "--max-offline-sessions", "200")
ANSWER_S = 30.0
LINGER_S = 0.05  # for what the broker need not end
DELAYS = {"median delay": "median_s", "99%": "p99_s", "longest": "max_s"}
_RST = struct.pack("ii", 1, 0)


@dataclass
class Result:
    """Of one run; `wrong` is what the oracle found."""

    by_kind: dict[str, Counter[str]]
    seconds: float = 0.0
    cpu_s: float = 0.0
    rss_growth_bytes: int = 0
    fds: tuple[int, int] = (0, 0)
    honest: dict[str, float] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)


async def be_hostile(kind: Kind, address: tuple[str, int], rng: random.Random) -> str:
    """One connection; returns who ended it: broker, us, or late (the broker, who should have)."""
    loop = asyncio.get_running_loop()
    with socket.socket() as sock:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RST)
        try:
            await loop.sock_connect(sock, address)
            if kind.connects:
                client_id = kind.client_id or f"{rng.randrange(10**9)}"
                will = ("will/fuzz", b"gone") if kind.will else None
                await loop.sock_sendall(
                    sock, connect(client_id, clean=kind.clean, keepalive_s=kind.keepalive_s, will=will)
                )
                await asyncio.wait_for(loop.sock_recv(sock, 4), ANSWER_S)
            data = kind.make(rng)
            for piece in (data[i : i + 1] for i in range(len(data))) if kind.slowly else (data,):
                await asyncio.wait_for(loop.sock_sendall(sock, piece), ANSWER_S)
                await asyncio.sleep(0.01 if kind.slowly else 0)
            return await _end_of(sock, kind)
        except (ConnectionError, TimeoutError) as error:
            return "late" if isinstance(error, TimeoutError) else "broker"


async def _end_of(sock: socket.socket, kind: Kind) -> str:
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(ANSWER_S if kind.ends else LINGER_S):
            while await loop.sock_recv(sock, 65536):
                pass
        return "broker"
    except TimeoutError:
        return "late" if kind.ends else "us"


async def attack(
    address: tuple[str, int], kinds: Sequence[Kind], connections: int, seed: int, at_once: int, minutes: float
) -> dict[str, Counter[str]]:
    """All connections, `at_once` of them at a time; their order and bytes follow from the seed."""
    by_kind = {kind.name: Counter[str]() for kind in kinds}
    until_s = time.monotonic() + 60 * minutes
    numbers = itertools.takewhile(lambda _: time.monotonic() < until_s, range(connections))

    async def worker() -> None:
        for number in numbers:
            kind = kinds[number % len(kinds)]
            by_kind[kind.name][await be_hostile(kind, address, random.Random(f"{seed} {number}"))] += 1

    await asyncio.gather(*(worker() for _ in range(at_once)))
    return by_kind


def settled_fds(process: psutil.Process, wanted: int) -> int:
    """File descriptors once the broker has seen that all have gone."""
    deadline_s = time.monotonic() + ANSWER_S
    while (fds := process.num_fds()) > wanted and time.monotonic() < deadline_s:
        time.sleep(0.05)
    return fds


@contextlib.contextmanager
def attacked(errors: IO[str], proxy: str | None) -> Iterator[Running]:
    """The embedded broker, or the proxy before it or before Mosquitto."""
    with contextlib.ExitStack() as stack:
        broker = stack.enter_context(mosquitto() if proxy == "mosquitto" else embedded(*LIMITS, log=errors))
        yield stack.enter_context(metered(broker.url, errors)) if proxy else broker


def run(
    connections: int, seed: int, at_once: int, rss_limit_mb: float, log: Path, minutes: float = math.inf,
    *, proxy: str | None = None,
) -> Result:  # fmt: skip
    """Start a broker, attack it, and look at what is left."""
    kinds = [replace(kind, ends=kind.ends and proxy != "mosquitto") for kind in KINDS]
    with log.open("w") as errors, attacked(errors, proxy) as broker, HonestPair(broker.url) as pair:
        address, process, child = parse_url(broker.url), psutil.Process(broker.pid), broker.process
        pair.wait_for(50)
        rss, fds, begun_s = process.memory_info().rss, process.num_fds(), time.monotonic()
        result = Result(asyncio.run(attack((address.host, address.port), kinds, connections, seed, at_once, minutes)))
        result.seconds, result.cpu_s = time.monotonic() - begun_s, sum(process.cpu_times()[:2])
        result.fds = fds, settled_fds(process, fds)
        result.rss_growth_bytes = process.memory_info().rss - rss
        result.honest = pair.finish()
        if child.poll() is not None:
            result.wrong.append(f"the broker ended with code {child.returncode}")
    _look_for_faults(result, rss_limit_mb, log.read_text(errors="replace"), child.returncode)
    return result


def _look_for_faults(result: Result, rss_limit_mb: float, log: str, code: int | None) -> None:
    checks = {
        f"the broker ended with code {code}": code != 0,
        "a traceback in the broker's log": "Traceback" in log or "never retrieved" in log,
        f"file descriptors {result.fds[0]} -> {result.fds[1]}": result.fds[1] > result.fds[0],
        f"memory grew by more than {rss_limit_mb:.0f} MB": result.rss_growth_bytes > rss_limit_mb * MEGABYTE,
        "connections not ended that had to be": any(ends["late"] for ends in result.by_kind.values()),
        "honest messages lost": result.honest["lost"] > 0,
        "honest messages changed or out of order": result.honest["wrong"] > 0,
    }
    result.wrong += [what for what, is_so in checks.items() if is_so]


def show(result: Result) -> None:
    """The table and the oracle's figures."""
    print(f"{'kind':32}{'connections':>12}{'by broker':>11}{'by us':>8}{'late':>6}")
    for name, ends in result.by_kind.items():
        print(f"{name:32}{ends.total():12}{ends['broker']:11}{ends['us']:8}{ends['late']:6}")
    total = sum(ends.total() for ends in result.by_kind.values())
    honest = result.honest
    print(f"{total} connections in {result.seconds:.0f} s ({total / result.seconds:.0f}/s)")
    print(
        f"broker: {result.cpu_s:.0f} s of processor, memory {result.rss_growth_bytes / MEGABYTE:+.1f} MB, "
        f"descriptors {result.fds[0]} -> {result.fds[1]}"
    )
    delays = ", ".join(f"{name} {honest[key] * 1e3:.0f} ms" for name, key in DELAYS.items())
    print(
        f"honest pair: {honest['sent']:.0f} messages, {honest['lost']:.0f} lost, {honest['wrong']:.0f} wrong; {delays}"
    )
    print("found: " + ("; ".join(result.wrong) or "nothing wrong"))


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--connections", type=int, default=100_000)
    known.add_argument("--seed", type=int, default=1)
    known.add_argument("--at-once", type=int, default=48)
    known.add_argument("--minutes", type=float, default=math.inf, help="stop earlier")
    known.add_argument("--rss-limit-mb", type=float, default=160.0)
    known.add_argument(
        "--proxy", nargs="?", const="embedded", choices=("embedded", "mosquitto"),
        help="attack a metering proxy before this broker (if none is named, the embedded one)",
    )  # fmt: skip
    known.add_argument("--log", type=Path, help="keep the broker's log")
    options = known.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        log = options.log or Path(folder, "broker.log")
        how = options.connections, options.seed, options.at_once, options.rss_limit_mb, log, options.minutes
        result = run(*how, proxy=options.proxy)
    show(result)
    sys.exit(1 if result.wrong else 0)


if __name__ == "__main__":
    main()
