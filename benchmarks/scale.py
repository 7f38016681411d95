"""How a deployment grows: 12, 48, 96 and 200 robots of a toy on one machine, each with the embedded broker.

    python -m benchmarks.scale [--robots 12 48 96 200] [--rounds 10] [--size toy] [--out scale.csv]

Clusters of 4 robots in a ring, none of which can reach its target: traffic a robot and rounds are the same at each
size, so whatever a robot-round costs more at 200 than at 12 is what grows with the others. `jouleswarm run` starts
all of it, as for anybody; `--size quick` takes robots with the compact network and the full-size world. Per
robot-round: CPU time of robots (their start is in it), of the broker, and of the run's own process, which records;
wire bytes by the run's meter, in and out of the broker. What is done once however many robots there are is told
apart: the fork server loads the libraries for all, and run and broker have begun before it does. PSS is a robot's
(the median) once all are in their first round.
"""

from __future__ import annotations

import contextlib
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from benchmarks.harness import MEGABYTE, parser
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.runs.directory import STATE

CLUSTER = 4
GOAL = 1.2
LOOK_S = 0.1
COLUMNS = (
    "robots", "start_s", "robots_ms", "broker_ms", "run_ms", "all_ms", "ratio", "broker_share", "once_s",
    "wire_bytes", "pss_mb", "fds_broker", "fds_run",
)  # fmt: skip
MAPS = ("E * * X", "E * X .", ". E * X")
WORLD = ("world.rows=1", "world.cols=4")  # of MAPS
OVERRIDES = (
    "name=scale", "methods=['fl']", "federation.topology=ring",
    f"federation.robots_per_cluster={CLUSTER}", "federation.target_reward=1e9", "meta.training_tasks=[]",
)  # fmt: skip


@dataclass
class Seen:
    """What a run showed while it ran."""

    start_s: float = 0.0
    pss_mb: list[float] = field(default_factory=list)
    cpu_s: dict[str, float] = field(default_factory=dict)
    """By process, the robots left out."""
    begun: dict[str, float] = field(default_factory=dict)
    """What run and broker had used when the fork server came."""
    fds: dict[str, int] = field(default_factory=dict)
    """At most."""


def scenario_file(folder: Path, robots: int, rounds: int, size: str) -> Path:
    """A scenario of so many robots, resolved."""
    world = WORLD if size == "toy" else ()
    changes = [*OVERRIDES, *world, ("tasks", tasks_of(size, robots)), ("federation.max_rounds", rounds)]
    scenario = load_scenario(size, changes)
    (path := folder / "scale.json").write_text(json.dumps({"scenario": scenario.model_dump(mode="json")}))
    return path


def tasks_of(size: str, robots: int) -> list[dict[str, object]]:
    """Clusters enough for so many robots; those of the toy have small maps, others the scenario's own."""
    maps = MAPS if size == "toy" else [task.map for task in load_scenario(size).tasks]
    return [{"id": number + 1, "map": maps[number % len(maps)]} for number in range(robots // CLUSTER)]


def measure(robots: int, rounds: int, size: str = "toy") -> dict[str, float]:
    """One row of the table."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = scenario_file(Path(folder), robots, rounds, size)
        command = [sys.executable, "-m", "jouleswarm", "run", str(scenario), "--out", folder, "--run-id", "scale"]
        with (Path(folder) / "log").open("w") as log:
            begun_s = time.monotonic()
            run = subprocess.Popen([*command, "--no-figures"], stdout=log, stderr=subprocess.STDOUT)
            seen = _watch(run.pid, Path(folder) / "scale" / STATE, robots, begun_s)
            all_s = seen.cpu_s.pop("all")
            if run.wait():
                sys.exit(f"{robots} robots: the run failed\n{Path(folder, 'log').read_text()[-2000:]}")
        wire = sum(_wire(Path(folder) / "scale" / "meter.jsonl"))
    per = 1e3 / (robots * rounds)
    robots_s = all_s - sum(seen.cpu_s.values())
    once_s = seen.cpu_s["fork server"] + sum(seen.begun.values())
    counted_s = all_s - once_s
    return {
        "robots": robots,
        "start_s": seen.start_s,
        "robots_ms": robots_s * per,
        "broker_ms": (seen.cpu_s["broker"] - seen.begun["broker"]) * per,
        "run_ms": (seen.cpu_s["run"] - seen.begun["run"]) * per,
        "all_ms": counted_s * per,
        "broker_share": (seen.cpu_s["broker"] - seen.begun["broker"]) / counted_s,
        "once_s": once_s,
        "wire_bytes": wire / (robots * rounds),
        "pss_mb": statistics.median(seen.pss_mb),
        "fds_broker": seen.fds["broker"],
        "fds_run": seen.fds["run"],
    }


def _watch(pid: int, state: Path, robots: int, begun_s: float) -> Seen:
    """Look at a run until it has ended; it isn't waited for, so that its times can still be read."""
    seen, run = Seen(), psutil.Process(pid)
    while os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        for name, each in _helpers(run):
            with contextlib.suppress(psutil.Error):
                seen.cpu_s[name] = _cpu_s(each)
                if name == "fork server" and not seen.begun:
                    seen.begun = {other: seen.cpu_s[other] for other in ("run", "broker")}
                seen.fds[name] = max(seen.fds.get(name, 0), each.num_fds())
        if not seen.pss_mb and sum(1 for _ in state.glob("agent-*/*.0")) >= robots:  # kept in round 0
            seen.start_s = time.monotonic() - begun_s
            for each in run.children(recursive=True):
                with contextlib.suppress(psutil.Error):
                    if each.ppid() != pid:
                        seen.pss_mb.append(each.memory_full_info().pss / MEGABYTE)
        time.sleep(LOOK_S)
    times = run.cpu_times()  # of a process that has ended and those that it has waited for
    seen.cpu_s["run"] = times.user + times.system
    seen.cpu_s["all"] = sum(times[:4])
    return seen


def _helpers(run: psutil.Process) -> Iterator[tuple[str, psutil.Process]]:
    """The run itself, its broker and its fork server."""
    yield "run", run
    with contextlib.suppress(psutil.Error):
        for each in run.children():
            with contextlib.suppress(psutil.Error):
                line = " ".join(each.cmdline())
                if "jouleswarm.broker" in line:
                    yield "broker", each
                elif "forkserver" in line:
                    yield "fork server", each


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _wire(meter: Path) -> Iterator[int]:
    for line in meter.read_text().splitlines():
        row = json.loads(line)
        if row["side"] == "broker" and row["direction"] in ("in", "out"):
            yield row["packet_bytes"]


def told(row: dict[str, float], first: dict[str, float]) -> str:
    """A row in words."""
    return (
        f"{row['robots']:.0f} robots: in their first round after {row['start_s']:.1f} s; CPU a robot-round "
        f"{row['all_ms']:.1f} ms (robots {row['robots_ms']:.1f}, broker {row['broker_ms']:.2f}, run "
        f"{row['run_ms']:.2f}; broker's share {row['broker_share']:.1%}), {row['wire_bytes']:.0f} wire bytes, PSS "
        f"{row['pss_mb']:.1f} MB a robot, open files {row['fds_broker']:.0f} of the broker and {row['fds_run']:.0f} of "
        f"the run, {row['once_s']:.1f} s once; CPU a robot-round against {first['robots']:.0f} "
        f"robots (goal {GOAL}): ratio {row['ratio']:.3f}"
    )


def write(out: Path, rows: Sequence[dict[str, float]]) -> None:
    """The table as CSV."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows({name: f"{value:.5g}" for name, value in row.items()} for row in rows)


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--robots", type=int, nargs="+", default=[12, 48, 96, 200], help=f"multiples of {CLUSTER}")
    known.add_argument("--rounds", type=int, default=10)
    known.add_argument("--size", choices=["toy", "quick", "paper"], default="toy", help="whose network and world")
    known.add_argument("--out", type=Path, help="write the table as CSV too")
    options = known.parse_args()
    if odd := [each for each in options.robots if each < CLUSTER or each % CLUSTER]:
        known.error(f"--robots {odd}: expected multiples of {CLUSTER}, the robots of a cluster")
    rows: list[dict[str, float]] = []
    for robots in options.robots:
        row = measure(robots, options.rounds, options.size)
        rows.append(row | {"ratio": row["all_ms"] / (rows[0]["all_ms"] if rows else row["all_ms"])})
        print(told(rows[-1], rows[0]), flush=True)
    if options.out is not None:
        write(options.out, rows)


if __name__ == "__main__":
    main()
