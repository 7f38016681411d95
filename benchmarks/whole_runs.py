"""Whole runs, here and at an earlier commit, in turn: CPU-seconds of all their processes, and how near the floor.

    python -m benchmarks.whole_runs [--against 7ee9b9a] [--pairs 4] [--what quick] [--set section.key=value]
    python -m benchmarks.whole_runs --pairs 1 --what study

Each side has its own code and defaults, and the same seed. As rounds differ between versions, the ratio is told by
robot-round too, all of a run's CPU time over the rounds of its robots; with `--set "methods=['fl']"` there is nothing
else in it. The floor is what a run's gradients alone would take: their number, as the run's rows count them, times a
bare PyTorch step of one thread as `benchmarks.gradient_step` measures it. The earlier commit comes out of the
repository's history: without it this benchmark says so.
"""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.gradient_step import STEPS, bare_loop
from benchmarks.harness import cpu_seconds, in_turn, parser, ratio
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario

ROOT = Path(__file__).resolve().parents[1]
BEFORE = "7ee9b9a"
GOAL = 0.55
LONGEST_S = 3600.0
_WAITER = (
    "import json, resource, subprocess, sys; code = subprocess.call(sys.argv[1:], stdout=sys.stderr); "
    "used = resource.getrusage(resource.RUSAGE_CHILDREN); print(json.dumps([code, used.ru_utime + used.ru_stime]))"
)
_STARTS = {  # a commit before the code was moved into one package has no `python -m jouleswarm`
    True: ("-m", "jouleswarm"),
    False: ("-c", "import sys; from studies.cli import main; sys.argv[0] = 'jouleswarm'; main()"),
}


@dataclass(frozen=True)
class Run:
    """What one whole run took."""

    cpu_s: float
    robot_rounds: int
    meta_rounds: int
    gradients: int


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--against", default=BEFORE, metavar="COMMIT", help="the other side")
    known.add_argument("--pairs", type=int, default=4, help="how often both sides are run, in turn")
    known.add_argument("--what", choices=["quick", "study"], default="quick", help="study: `study paper --seeds 1`")
    known.add_argument("--set", action="append", default=[], help="of the scenario of both sides (quick alone)")
    options = known.parse_args()
    found: dict[str, list[Run]] = {"here": [], options.against: []}
    with checkout(options.against) as other:
        sides = {"here": ROOT, options.against: other}

        def once(side: str) -> float:
            run = whole(sides[side], options.what, options.set)
            found[side].append(run)
            print(f"{side}: {run}", file=sys.stderr, flush=True)
            return run.cpu_s

        taken = in_turn({side: lambda side=side: once(side) for side in sides}, options.pairs, 0)
    for side, runs in found.items():
        print(told(side, runs))
    print(
        f"CPU-seconds of {options.what} here / at {options.against} (goal {GOAL}): ratio {ratio(*taken.values()):.3f}"
    )
    per_round = [[each.cpu_s / max(1, each.robot_rounds) for each in runs] for runs in found.values()]
    print(f"the same by robot-round: ratio {ratio(*per_round):.3f}")
    if options.what == "quick":
        print(floor(found["here"], options.set))


@contextlib.contextmanager
def checkout(commit: str) -> Iterator[Path]:
    """The files of a commit, in a worktree of git's in a folder for a while."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "checkout")
        made = ["git", "worktree", "add", "--detach", str(path), commit]
        done = subprocess.run(made, cwd=ROOT, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"commit {commit}: no worktree of it ({done.stderr.strip()}); it needs a clone with all history")
        try:
            yield path
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(path)], cwd=ROOT, check=False)


def whole(root: Path, what: str, settings: list[str]) -> Run:
    """One run of a checkout from the first process to the last, the report's figures left out."""
    with tempfile.TemporaryDirectory() as folder:
        asked = ["run", str(root / "scenarios" / "quick.toml"), "--seed", "1", "--run-id", "whole", "--out", folder]
        asked += [part for each in settings for part in ("--set", each)]
        if what == "study":
            asked = ["study", "paper", "--seeds", "1", "--out", folder]
        start = _STARTS[(root / "jouleswarm" / "__main__.py").exists()]
        command = [sys.executable, "-c", _WAITER, sys.executable, *start, *asked]
        environment = {**os.environ, "PYTHONPATH": str(root)}
        done = subprocess.run(
            command, cwd=root, env=environment, capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
        code, cpu_s = json.loads(done.stdout.splitlines()[-1])
        if code:
            sys.exit(f"{root}: {what} ended with {code}\n{done.stderr[-2000:]}")
        lines = [json.loads(line) for file in Path(folder).rglob("rounds.jsonl") for line in file.open()]
    robots = sum(1 for row in lines if row["agent"] and row["round"])
    meta = {(row["arm"], row["round"]) for row in lines if not row["agent"]}
    return Run(cpu_s, robots, len(meta), sum(row["gradients"] for row in lines))


def told(side: str, runs: list[Run]) -> str:
    """Medians of a side, in words."""
    cpu_s = statistics.median(each.cpu_s for each in runs)
    robots, metas = (
        statistics.median(getattr(each, name) for each in runs) for name in ("robot_rounds", "meta_rounds")
    )
    spread = f"{min(each.cpu_s for each in runs):.1f} to {max(each.cpu_s for each in runs):.1f}"
    return f"{side}: {cpu_s:.1f} CPU-seconds ({spread}), {robots:.0f} robot-rounds and {metas:.0f} meta-rounds"


def floor(runs: list[Run], settings: list[str]) -> str:
    """What the gradients alone would take."""
    use_one_thread()
    steps = bare_loop(load_scenario("quick", settings))
    steps()
    step_s = statistics.median(cpu_seconds(steps) / STEPS for _ in range(7))
    gradients = statistics.median(each.gradients for each in runs)
    whole_s = statistics.median(each.cpu_s for each in runs)
    return (
        f"the floor: {gradients:.0f} gradients of {step_s * 1e3:.2f} ms are {gradients * step_s:.1f} CPU-seconds; "
        f"whole run / floor {whole_s / (gradients * step_s):.2f}x"
    )


if __name__ == "__main__":
    main()
