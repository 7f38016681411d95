"""A toy deployment of many robots for long: does any process grow with the rounds?

    python -m benchmarks.soak [--robots 24] [--minutes 30] [--out samples.csv]

Samples memory and file descriptors of every process every few seconds, with the rounds done, and fits a line of memory
against rounds once the first quarter is over. Exit code 1 where a process grows by 1 MB or more in 1000 rounds, where
descriptors grow, or where a message was refused, asked for again, or is in one side's byte counters only.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from benchmarks.harness import MEGABYTE, parser, write_rows

LIMIT_MB = 1.0  # in 1000 rounds
WARM_UP = 0.25  # of the rounds: allocators, caches, the replay memory fill
TOY = Path(__file__).parents[1] / "scenarios" / "toy.toml"
# Rounds as short as they can be, and no end to them.
OVERRIDES = (
    "methods=['fl']", "federation.target_reward=1e9", "federation.max_rounds=1000000", "learning.batches_per_round=1",
    "learning.motions_per_round=2", "learning.batch_size=2", "learning.replay_size=50", "world.max_motions=2",
    "camera.width=16", "camera.height=12", "network.conv=[[4,4,2]]", "network.dense=[8]",
)  # fmt: skip


@dataclass(frozen=True)
class Sample:
    """One process at one time."""

    time_s: float
    process: str
    rounds: int
    rss_bytes: int
    fds: int


@dataclass(frozen=True)
class Trend:
    """How a process went on after its warm-up."""

    process: str
    rounds: int
    mb_per_1000: float
    fds: tuple[int, int]

    @property
    def is_flat(self) -> bool:
        return self.mb_per_1000 < LIMIT_MB and self.fds[1] <= self.fds[0]


def trend(samples: Sequence[Sample]) -> Trend:
    """A line through one process's memory against rounds, warm-up left out."""
    last = samples[-1].rounds
    kept = [each for each in samples if each.rounds >= WARM_UP * last]
    rounds = np.array([each.rounds for each in kept], float)
    rss_mb = np.array([each.rss_bytes for each in kept]) / MEGABYTE
    slope = float(np.polyfit(rounds, rss_mb, 1)[0]) * 1000 if len(set(rounds)) > 1 else 0.0
    return Trend(samples[0].process, last, slope, (kept[0].fds, kept[-1].fds))


def names(run: psutil.Process) -> dict[int, str]:
    """Processes of a deployment, by what they do."""
    found = {run.pid: "recorder"}
    for child in run.children(recursive=True):
        with contextlib.suppress(psutil.Error):
            words = child.cmdline()
            if "broker" in words:
                found[child.pid] = "broker"
            elif child.ppid() != run.pid:  # children of the fork server
                found[child.pid] = f"robot {child.pid}"
    return found


def rounds_done(rounds: Path) -> int:
    """The newest row's round; robots are within one of each other."""
    if not rounds.exists() or not rounds.stat().st_size:
        return 0
    with rounds.open("rb") as file:
        file.seek(max(0, rounds.stat().st_size - 4096))
        lines = file.read().split(b"\n")
    return int(json.loads(lines[-2])["round"]) if len(lines) > 1 else 0


def watch(run: subprocess.Popen[bytes], folder: Path, minutes: float, every_s: float) -> list[Sample]:
    """Samples until the time is over or the run ends by itself."""
    begun_s, samples, root = time.monotonic(), [], psutil.Process(run.pid)
    while time.monotonic() - begun_s < 60 * minutes and run.poll() is None:
        time.sleep(every_s)
        done = rounds_done(folder / "rounds.jsonl")
        for pid, name in names(root).items() if done else ():
            with contextlib.suppress(psutil.Error):
                process = psutil.Process(pid)
                sample = Sample(time.monotonic() - begun_s, name, done, process.memory_info().rss, process.num_fds())
                samples.append(sample)
    return samples


def missing(taken: int, delivered: int) -> bool:
    """Whether a neighbour was not handed a message; robots that are ended need not get the last round's any more."""
    neighbours = round(delivered / taken) if taken else 0
    return not neighbours or taken * neighbours - delivered > neighbours


def messages_amiss(folder: Path) -> list[str]:
    """What was refused or asked for again, and sidelink bytes that the broker took in and nobody was handed."""
    rows = [json.loads(line) for line in (folder / "meter.jsonl").read_text().splitlines()]
    last = [json.loads(line) for line in (folder / "rounds.jsonl").read_text().splitlines()[-200:]]
    logs = "".join(path.read_text(errors="replace") for path in (folder / "logs").iterdir())
    weights = [row for row in rows if row["side"] == "broker" and row["link"] == "sidelink"]
    by_topic: dict[str, Counter[str]] = defaultdict(Counter)
    for row in weights:
        by_topic[row["topic"]][row["direction"]] += row["messages"]
    lost = {topic: ways for topic, ways in by_topic.items() if missing(ways["in"], ways["out"])}
    checks = {
        "no broker counters": not weights,
        f"messages lost: {lost}": bool(lost),
        "refused messages": any(row["refused"] for row in last) or "refused a message" in logs,
        "requests to send again": any(row["topic"].endswith("/resend") for row in rows),
        "a traceback": "Traceback" in logs,
    }
    return [what for what, is_so in checks.items() if is_so]


def soak(robots: int, minutes: float, every_s: float, out: Path | None, parent: Path) -> bool:
    """Run, sample, judge; whether all is well."""
    sets = [part for each in (*OVERRIDES, f"federation.robots_per_cluster={robots // 2}") for part in ("--set", each)]
    command = [sys.executable, "-m", "jouleswarm", "run", str(TOY), "--out", str(parent), "--run-id", "soak", *sets]
    with (parent / "output.txt").open("wb") as output:
        run = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, start_new_session=True)
    try:
        samples = watch(run, parent / "soak", minutes, every_s)
        early = run.poll() is not None
    finally:
        if run.poll() is None:
            os.kill(run.pid, signal.SIGTERM)  # a shell starts background jobs deaf to SIGINT
        run.wait(120)
    if early or not samples:
        print((parent / "output.txt").read_text()[-2000:])
        return False
    write_rows(out, list(Sample.__annotations__), [list(vars(each).values()) for each in samples])
    by_process: dict[str, list[Sample]] = defaultdict(list)
    for sample in samples:
        by_process[sample.process].append(sample)
    trends = [trend(each) for each in by_process.values()]
    amiss = messages_amiss(parent / "soak")
    show(trends, amiss)
    return all(each.is_flat for each in trends) and not amiss


def show(trends: Sequence[Trend], amiss: Sequence[str]) -> None:
    """The table and the verdicts."""
    print(f"{'process':16}{'rounds':>8}{'MB per 1000 rounds':>20}{'descriptors':>14}")
    for each in trends:
        print(f"{each.process:16}{each.rounds:8}{each.mb_per_1000:20.3f}{each.fds[0]:>8} -> {each.fds[1]}")
    grows = [each.process for each in trends if each.mb_per_1000 >= LIMIT_MB]
    leaks = [each.process for each in trends if each.fds[1] > each.fds[0]]
    print(f"memory below {LIMIT_MB:g} MB per 1000 rounds: {'no: ' + ', '.join(grows) if grows else 'yes'}")
    print(f"descriptors flat: {'no: ' + ', '.join(leaks) if leaks else 'yes'}")
    print(f"no message lost, refused or asked for again: {'no: ' + '; '.join(amiss) if amiss else 'yes'}")


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--robots", type=int, default=24)
    known.add_argument("--minutes", type=float, default=30.0)
    known.add_argument("--every-s", type=float, default=5.0)
    known.add_argument("--out", type=Path, help="samples as CSV")
    options = known.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(0 if soak(options.robots, options.minutes, options.every_s, options.out, Path(folder)) else 1)


if __name__ == "__main__":
    main()
