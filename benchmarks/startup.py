"""What it takes until all robots are in their first round, here and in an earlier commit, by CPU time.

    python -m benchmarks.startup [--against COMMIT] [--robots 48] [--pairs 5]

Robots of `toy` without a data center, forked as `jouleswarm run` forks them, from a manifest. Round 0, in which each
tries the model that it starts from, is part of it. `--help` is a process of its own.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

from benchmarks.harness import compare, embedded, parser

ROOT = Path(__file__).resolve().parents[1]
BEFORE = "5b80376"  # the last commit before this was looked at
LONGEST_S = 300.0
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")  # as the launcher


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--against", default=BEFORE, metavar="COMMIT", help="the other side")
    known.add_argument("--robots", type=int, default=48, help="in two clusters")
    known.add_argument("--pairs", type=int, default=5, help="how often both sides are measured, in turn")
    options = known.parse_args()
    found: dict[str, dict[str, list[float]]] = {}
    with tempfile.TemporaryDirectory() as folder, _checkout(options.against) as other:
        sides = {"here": ROOT, options.against: other}
        manifests = {side: _manifest(Path(folder, f"{side}.json"), sides[side], options.robots) for side in sides}
        for number in range(options.pairs):
            for side in list(sides)[:: 1 if number % 2 else -1]:
                taken = _start(sides[side], manifests[side], options.robots) | {"--help": _help_s(sides[side])}
                for what, value in taken.items():
                    found.setdefault(what, {name: [] for name in sides})[side].append(value)
    for what, of_sides in found.items():
        print(compare(what, of_sides))


@contextlib.contextmanager
def _checkout(commit: str) -> Iterator[Path]:
    """The files of a commit, in a folder for a while."""
    with tempfile.TemporaryDirectory() as folder:
        archive = subprocess.run(["git", "archive", commit], cwd=ROOT, stdout=subprocess.PIPE, check=True)
        subprocess.run(["tar", "-x", "-C", folder], input=archive.stdout, check=True)
        yield Path(folder)


_MANIFEST = """
import json, sys
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.learning.networks import interface_of
scenario = load_scenario("toy", sys.argv[1:])
print(json.dumps({name: each.model_dump(mode="json") for name, each in
    (("scenario", scenario), ("interface", interface_of(scenario)))}))
"""


def _manifest(path: Path, checkout: Path, robots: int) -> Path:
    """By the code that is to read it: each commit has fields of its own."""
    settings = ["methods=['fl']", f"federation.robots_per_cluster={robots // 2}"]
    command = [sys.executable, "-c", _MANIFEST, *settings]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    with path.open("w", encoding="utf-8") as file:
        subprocess.run(command, cwd=checkout, env=environment, stdout=file, check=True)
    return path


def _start(checkout: Path, manifest: Path, robots: int) -> dict[str, float]:
    """Seconds of CPU time: a robot's (the median), the fork server's, and of all with the broker."""
    mine, theirs = socket.socketpair()
    with tempfile.TemporaryDirectory() as folder, embedded() as broker, mine:
        told = Path(folder, "told")
        program = [sys.executable, "-P", str(ROOT / "benchmarks" / "first_round.py"), str(checkout)]
        command = [*program, str(theirs.fileno()), str(os.getpid()), str(told)]
        environment = {**os.environ, **ONE_THREAD}
        with theirs:
            server = subprocess.Popen(command, pass_fds=[theirs.fileno()], env=environment, cwd=checkout)
        try:
            for agent in range(1, robots + 1):
                given = ["--id", str(agent), "--broker", broker.url, "--scenario", str(manifest)]
                order = ["jouleswarm.agents", [*given, "--state", f"{folder}/{agent}"], f"{folder}/{agent}.log"]
                mine.sendall(json.dumps(order).encode() + b"\n")
                mine.recv(4096)
            spent = _await(told, robots + 1)
            times = psutil.Process(broker.pid).cpu_times()
        finally:
            server.kill()  # and its robots with it
            server.wait()
    robot_s = [value for who, value in spent if who == "robot"]
    (server_s,) = (value for who, value in spent if who == "server")
    return {
        "a robot": statistics.median(robot_s),
        "the fork server": server_s,
        f"{robots} robots": sum(robot_s),
        f"{robots} robots, fork server and broker": sum(robot_s) + server_s + times.user + times.system,
    }


def _await(told: Path, count: int) -> list[tuple[str, float]]:
    deadline_s = time.monotonic() + LONGEST_S
    while time.monotonic() < deadline_s:
        lines = told.read_text(encoding="utf-8").splitlines() if told.exists() else []
        if len(lines) == count:
            return [(who, float(spent)) for who, spent in map(str.split, lines)]
        time.sleep(0.1)
    sys.exit(f"{told}: {len(lines)} of {count} processes came so far in {LONGEST_S:g} s")


def _help_s(checkout: Path) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "jouleswarm", "--help"]
    subprocess.run(command, cwd=checkout, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
