"""What the benchmarks share: brokers, sides measured in turn, tables."""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from jouleswarm.common.bus.mqtt import MqttBus

MEGABYTE = 1024 * 1024
_BROKER = (sys.executable, "-m", "jouleswarm.broker", "--port", "0", "--no-metrics", "--exit-with-stdin")
_MOSQUITTO_CONFIG = """\
listener {port} 127.0.0.1
allow_anonymous true
set_tcp_nodelay true
max_inflight_messages 0
max_queued_messages 0
log_type error
"""


@dataclass(frozen=True)
class Running:
    """A broker that runs."""

    url: str
    process: subprocess.Popen[str]

    @property
    def pid(self) -> int:
        return self.process.pid


@contextlib.contextmanager
def embedded(*options: str, log: IO[str] | None = None) -> Iterator[Running]:
    """The broker of this repository."""
    pipe = subprocess.PIPE
    with subprocess.Popen([*_BROKER, *options], stdin=pipe, stdout=pipe, stderr=log, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            yield Running(json.loads(process.stdout.readline())["url"], process)
        finally:
            process.stdin.close()
            process.wait(timeout=30)


@contextlib.contextmanager
def mosquitto() -> Iterator[Running]:
    """Mosquitto without limits and without Nagle's delay."""
    program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    if program is None:
        sys.exit("this benchmark compares with Mosquitto: apt-get install mosquitto")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "mosquitto.conf")
        config.write_text(_MOSQUITTO_CONFIG.format(port=port), encoding="utf-8")
        process = subprocess.Popen([program, "-c", str(config)], stderr=subprocess.DEVNULL, text=True)
        url = f"mqtt://127.0.0.1:{port}"
        MqttBus.connect(url, "probe").close()
        yield Running(url, process)
        process.terminate()
        process.wait(timeout=10)


@contextlib.contextmanager
def metered(url: str, log: IO[str] | None = None) -> Iterator[Running]:
    """The metering proxy before a broker."""
    with tempfile.TemporaryDirectory() as folder:
        (links := Path(folder, "links.toml")).write_text('"jouleswarm/#rest" = { link = "uplink" }\n', encoding="utf-8")
        options = ("--to", url, "--listen", "127.0.0.1:0", "--links", str(links), "--out", folder)
        command = (sys.executable, "-u", "-m", "jouleswarm", "meter", "proxy", *options)
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True) as process:
            assert process.stdout is not None
            port = process.stdout.readline().split("127.0.0.1:")[1].split()[0]
            try:
                yield Running(f"mqtt://127.0.0.1:{port}", process)
            finally:
                process.terminate()
                process.stdout.read()


def parser(doc: str | None) -> argparse.ArgumentParser:
    """Of a benchmark's options; its module's words are the help."""
    return argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)


def seconds(body: Callable[[], object]) -> float:
    """How long it takes."""
    begun_s = time.perf_counter()
    body()
    return time.perf_counter() - begun_s


def cpu_seconds(body: Callable[[], object]) -> float:
    """Processor time of this thread, whatever else the machine does."""
    begun_s = time.thread_time()
    body()
    return time.thread_time() - begun_s


def in_turn(sides: Mapping[str, Callable[[], float]], rounds: int, warm_up: int = 1) -> dict[str, list[float]]:
    """What each side gives in each round, the order turned round every time: a busy machine slows all of them alike."""
    found: dict[str, list[float]] = {name: [] for name in sides}
    for number in range(warm_up + rounds):
        for name in list(sides)[:: 1 if number % 2 else -1]:
            found[name].append(sides[name]())
    return {name: values[warm_up:] for name, values in found.items()}


def ratio(one: Sequence[float], other: Sequence[float]) -> float:
    """The median over rounds of one side over the other."""
    return statistics.median(a / b for a, b in zip(one, other, strict=True))


def compare(what: str, found: Mapping[str, Sequence[float]], unit: str = "ms", factor: float = 1e3) -> str:
    """Two sides in words: medians, how far they spread, and the ratio of the first to the second."""
    told = (
        f"{name} {statistics.median(held) * factor:.4g} {unit} ({min(held) * factor:.4g} to {max(held) * factor:.4g})"
        for name, held in found.items()
    )
    return f"{what}: {', '.join(told)}, ratio {ratio(*found.values()):.3f}"


def write_rows(out: Path | None, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A table as CSV, if it is asked for."""
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        with out.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows((columns, *rows))


def workers_parser(doc: str | None) -> argparse.ArgumentParser:
    """As `parser`, for what is done for several seeds at once by `in_workers`."""
    made = parser(doc)
    made.add_argument("--scenario", default="scenarios/quick.toml")
    made.add_argument("--seeds", type=int, nargs="+", default=[101, 102])
    made.add_argument("--workers", type=int, default=os.cpu_count())
    made.add_argument("--out", type=Path, help="write the rows as CSV too")
    return made


def in_workers(
    columns: Sequence[str],
    work: Callable[..., Sequence[Sequence[object]]],
    jobs: Sequence[Sequence[object]],
    options: argparse.Namespace,
) -> None:
    """Rows of all jobs, each in a process, printed as they come and written in the end."""
    rows: list[Sequence[object]] = []
    print(",".join(columns), flush=True)
    with ProcessPoolExecutor(options.workers) as pool:
        for found in pool.map(work, *zip(*jobs, strict=True)):
            rows += found
            for row in found:
                print(",".join(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row), flush=True)
    write_rows(options.out, columns, rows)
