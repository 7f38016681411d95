"""Tunes every method with the same budget: so many trials from stated ranges (benchmarks/tuning_ranges.py).

All trials are run on two seeds, the best quarter on all six (successive halving); best is who needs the fewest rounds
of all tasks together. The robots' learner is tuned on the arm without transfer, and is then every method's. Over the
in-memory bus, on seeds 101 to 106, which are in no study. Stop it whenever: units that are in trials.csv are not run
again, unless their scenario has changed; a change of the code alone it cannot know of (begin with another --out).

python -m benchmarks.tuning [--workers 2] [--trials 6] [--only fl maml-shared] [--out results/tuning]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import NamedTuple

from benchmarks.harness import parser
from benchmarks.tuning_ranges import BASELINE, METHODS, SCREENED, SEEDS, Tuned, draw
from benchmarks.tuning_table import Outcome, Row, read_rows, write_best, write_outcome, write_table, write_trials
from jouleswarm.common.process import one_line_errors
from jouleswarm.common.scenario.reading import load_scenario

Place = tuple[int, int]
"""(trial, seed)"""


class Unit(NamedTuple):
    """The least that is run: a method's trial on a seed."""

    method: str
    trial: int
    seed: int
    settings: tuple[str, ...]


def next_places(trials: int, seeds: Sequence[int], rounds: Mapping[Place, float]) -> list[Place]:
    """What is to be run of a method's trials: on the first seeds, and once those are there the best on the others."""
    screen = [(trial, seed) for seed in seeds[:SCREENED] for trial in range(trials)]
    if missing := [each for each in screen if each not in rounds]:
        return missing
    return [(trial, seed) for trial in best_of(trials, seeds, rounds) for seed in seeds if (trial, seed) not in rounds]


def best_of(trials: int, seeds: Sequence[int], rounds: Mapping[Place, float]) -> list[int]:
    """The best quarter, rounded up, of trials by their mean over the first seeds; of two alike the earlier one."""
    screened = {trial: statistics.fmean(rounds[trial, seed] for seed in seeds[:SCREENED]) for trial in range(trials)}
    return sorted(sorted(screened, key=lambda trial: (screened[trial], trial))[: math.ceil(trials / 4)])


class Tuner:
    """What is known, and what is to be run next."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options, self.trials_csv = options, options.out / "trials.csv"
        self.rows = {(row.method, row.scenario): row for row in read_rows(self.trials_csv)}
        self.methods = [tuned for tuned in METHODS if tuned.name in (BASELINE, *options.only)]
        self._digests: dict[Unit, str] = {}
        self._processes: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        for tuned in self.methods:  # a setting that cannot be is told before hours have been spent
            for unit in self._units(tuned, ()).values():
                self._digest(unit)

    def run(self) -> None:
        """Until nothing is left to do, or it is stopped: then units that run are given up."""
        running: dict[Future[dict[str, float]], Unit] = {}
        with ThreadPoolExecutor(self.options.workers) as pool:
            try:
                while True:
                    free = [unit for unit in self.waiting() if unit not in running.values()]
                    for unit in free[: self.options.workers - len(running)]:
                        running[pool.submit(self._measure, unit)] = unit
                    if not running:
                        return
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        self._record(running.pop(future), future.result())
            finally:
                with self._lock:
                    for process in self._processes:
                        process.kill()

    def waiting(self) -> list[Unit]:
        """Units that can be run now, in the order of the methods; others wait until the robots' settings are found."""
        baseline, *others = self.methods
        if (robots := self._robots()) is None:
            return self._left(baseline, ())
        return [unit for tuned in others for unit in self._left(tuned, robots)]

    def outcomes(self) -> list[Outcome]:
        """What is known of each method."""
        trials, told = self.options.trials, []
        every = trials * SCREENED + math.ceil(trials / 4) * (len(SEEDS) - SCREENED)
        for tuned in self.methods:
            robots = () if tuned.name == BASELINE else self._robots()
            rows = {} if robots is None else self._rows(tuned, robots)
            default = [row for (trial, seed), row in rows.items() if trial == 0 and seed in SEEDS[:SCREENED]]
            cpu_s = sum(row.cpu_s for row in rows.values())
            told.append(Outcome(tuned, self._best(rows), default, len(rows), every, cpu_s))
        return told

    def _units(self, tuned: Tuned, robots: tuple[str, ...]) -> dict[Place, Unit]:
        return {
            (trial, seed): Unit(tuned.name, trial, seed, (*robots, *tuned.fixed, *settings))
            for trial, settings in enumerate(draw(tuned, self.options.trials))
            for seed in SEEDS
        }

    def _rows(self, tuned: Tuned, robots: tuple[str, ...]) -> dict[Place, Row]:
        found = {place: (tuned.name, self._digest(unit)) for place, unit in self._units(tuned, robots).items()}
        return {place: self.rows[key] for place, key in found.items() if key in self.rows}

    def _left(self, tuned: Tuned, robots: tuple[str, ...]) -> list[Unit]:
        units, rows = self._units(tuned, robots), self._rows(tuned, robots)
        rounds = {place: float(row.rounds) for place, row in rows.items()}
        return [units[place] for place in next_places(self.options.trials, SEEDS, rounds)]

    def _robots(self) -> tuple[str, ...] | None:
        """The settings that are best without transfer; None as long as they are not known."""
        baseline = self.methods[0]
        if self._left(baseline, ()):
            return None
        return tuple(self._best(self._rows(baseline, ()))[0].settings.split())

    def _best(self, rows: Mapping[Place, Row]) -> list[Row]:
        """Rows of the trial with the lowest mean over all seeds, of those that have them all."""
        whole = [
            [rows[trial, seed] for seed in SEEDS]
            for trial in range(self.options.trials)
            if all((trial, seed) in rows for seed in SEEDS)
        ]
        return min(whole, key=lambda of_trial: sum(row.rounds for row in of_trial), default=[])

    def _overrides(self, unit: Unit) -> list[str]:
        (method,) = (tuned.method for tuned in METHODS if tuned.name == unit.method)
        options = self.options
        fixed = [f"methods=['{method}']", f"seed={unit.seed}", f"meta.t0={options.t0}", "camera.draw=input"]
        return [*fixed, f"federation.max_rounds={options.max_rounds}", *unit.settings]

    def _digest(self, unit: Unit) -> str:
        if unit not in self._digests:
            scenario = load_scenario(self.options.scenario, self._overrides(unit))
            ends = (scenario.federation.max_rounds, scenario.federation.target_reward)
            self._digests[unit] = hashlib.sha256(f"{scenario.determines} {ends}".encode()).hexdigest()[:12]
        return self._digests[unit]

    def _measure(self, unit: Unit) -> dict[str, float]:
        pipe, command = subprocess.PIPE, (sys.executable, "-m", "benchmarks.tuning_unit")
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
            with self._lock:
                self._processes.add(process)
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(json.dumps({"name": self.options.scenario, "overrides": self._overrides(unit)}) + "\n")
            process.stdin.flush()  # and stays open: the unit ends when this process does
            told = process.stdout.read()
            code = process.wait()
        with self._lock:
            self._processes.discard(process)
        if code:
            raise RuntimeError(f"{unit} ended with exit code {code}; see above")
        return dict(json.loads(told))

    def _record(self, unit: Unit, found: Mapping[str, float]) -> None:
        digest = self._digest(unit)
        settings = " ".join(unit.settings)
        row = Row(unit.method, unit.trial, settings, unit.seed, self.options.t0, **found, scenario=digest)  # type: ignore[arg-type]
        self.rows[unit.method, digest] = row
        self.write()
        outcomes = self.outcomes()
        done, every = sum(each.units for each in outcomes), sum(each.units_of for each in outcomes)
        failed = f", {row.not_learned} not learned" if row.not_learned else ""
        what = f"{row.method} trial {row.trial} seed {row.seed}"
        came = f"{row.rounds} rounds (seen {row.seen}, unseen {row.unseen}{failed}), {row.cpu_s:.0f} CPU s"
        print(f"{time.strftime('%H:%M:%S')} {done}/{every} {what}: {came}; {settings or 'as it stands'}", flush=True)

    def write(self) -> None:
        """All files anew."""
        options = self.options
        write_trials(self.trials_csv, list(self.rows.values()))
        write_outcome(options.out / "tuning.md", self.outcomes(), options.trials, options.t0, options.max_rounds)
        write_table(options.out / "tuning.csv", self.outcomes())
        write_best(options.out / "best.toml", self.outcomes())


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--scenario", default="scenarios/quick.toml")
    known.add_argument("--trials", type=int, default=6, help="of each method")
    known.add_argument("--only", nargs="+", choices=[each.name for each in METHODS], help="these, and fl before them")
    known.add_argument("--t0", type=int, default=90, help="rounds of meta-training")
    known.add_argument("--max-rounds", type=int, default=100, help="a task that is not learned by then counts as this")
    known.add_argument("--workers", type=int, default=2)
    known.add_argument("--out", type=Path, default=Path("results/tuning"))
    options = known.parse_args()
    options.only = options.only or [each.name for each in METHODS]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with one_line_errors("tuning"):
        tuner = Tuner(options)
    print(f"{len(tuner.rows)} units are in {tuner.trials_csv}, up to {len(tuner.waiting())} can be run now", flush=True)
    try:
        tuner.run()
    except KeyboardInterrupt:
        raise SystemExit("stopped; the same command goes on from here") from None
    tuner.write()
    print((options.out / "tuning.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
