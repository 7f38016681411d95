"""`jouleswarm chaos`: does a fault change anything but the clock? Runs a scenario undisturbed, then with faults."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import random
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from common.errors import RunError, usable
from common.runlog import MANIFEST, RoundRow, computed_on
from common.scenario import Scenario
from fleet.conservation import conservation
from fleet.faults import KINDS, FaultKind, Site, inject, onlooker, refused
from fleet.launcher import Launcher
from fleet.proxy import Proxy
from fleet.recorder import Recorder
from fleet.report_data import load_run
from fleet.run import Options, run_deployment

PHASES = ("starting", "meta-learning", "federated")
"""`starting` lasts to the first row, `federated` from the first robot's row of an arm to the next stage."""
_PHASE_OF = {"maml": "meta-learning", "fl": "federated"}

# At most, from the beginning of a phase or the last recovery to the next fault. Of what a phase has left of its rows
# half pass at most, so that a fast machine is not through with it before the fault.
_DELAY_S = {"starting": 1.0, "meta-learning": 1.0, "federated": 2.0}
_SHARE_OF_ROWS = 0.5
_RESTARTS = 1000
_IDLE_RUNS = 3
CSV = "chaos.csv"
_OF_TIME = ("seconds", "refused", "beta")
"""Of a row. `beta` is there only where it was measured, by time."""


@dataclass(frozen=True)
class Due:
    """When the next fault is due: at a time, or with a row, whichever comes first."""

    phase: str
    at_s: float
    rows: float


@dataclass
class Fault:
    """One fault that was injected."""

    kind: FaultKind
    phase: str
    target: str = ""
    run: str = ""
    at_s: float = 0.0
    recovery_s: float | None = None
    """From the fault to the next row of whom it was done to (of anybody, where that is no process)."""
    identical: bool | None = None
    conserved: bool | None = None
    """Whether what broker and clients have counted fits together."""
    note: str = ""

    @property
    def is_survived(self) -> bool:
        """Whether it has changed nothing but the clock."""
        return bool(self.identical and self.conserved) and self.note != "NOT refused"


@dataclass
class Chaos:
    """An intruder (`fleet.run.Intruder`) who injects the faults of a plan, one after the other."""

    scenario: Scenario
    options: list[str]
    run: str
    plan: list[Fault]
    pause_s: float
    rng: random.Random
    rows_in: dict[str, int]
    """Rows of each phase of the undisturbed run."""
    done: list[Fault] = field(default_factory=list)
    _open: Fault | None = None
    _before: int = 0
    """Rows at the open fault's injection, as `_count` counts them."""
    _due: Due | None = None
    _rows: list[RoundRow] = field(default_factory=list)
    """As they were at the beginning of this tick: the recorder reads them from its file."""

    @contextlib.contextmanager
    def line(self, url: str, launcher: Launcher, recorder: Recorder) -> Iterator[str]:
        """The processes talk to the broker by a proxy that can be told to spoil their connections."""
        eye = onlooker(url, self.run, self.scenario.bus.connect_timeout_s)
        with Proxy(url, self.rng.randrange(2**31)) as proxy:
            self._recorder = recorder
            self._site = Site(self.scenario, launcher, proxy, url, self.run, self.options, self.pause_s, self.rng, eye)
            try:
                yield proxy.url
            finally:
                self._site.end()
                eye.close()

    def tick(self) -> None:
        """Inject a fault of the phase that the run is in, and see whether the last one has been got over."""
        self._site.tick()
        self._rows = self._recorder.rows
        now_s, phase = time.monotonic(), self.phase
        if self._open is not None:
            self._look_at(self._open)
            return
        fault = next((each for each in self.plan if each.phase == phase), None)
        if fault is None:
            self._due = None
        elif self._due is None or self._due.phase != phase:
            self._due = self._draw(phase, now_s)
        elif now_s >= self._due.at_s or self._rows_of(phase) >= self._due.rows:
            self.plan.remove(fault)
            self.done.append(fault)
            fault.target, fault.run, fault.at_s = inject(fault.kind, self._site), self.run, self._recorder.elapsed_s
            self._open, self._before, self._due = fault, self._count(fault), None

    @property
    def phase(self) -> str:
        """Where the run is, by its newest row."""
        return _PHASE_OF[self._rows[-1].phase] if self._rows else "starting"

    def _rows_of(self, phase: str) -> int:
        return sum(_PHASE_OF[row.phase] == phase for row in self._rows)

    def _draw(self, phase: str, now_s: float) -> Due:
        so_far = self._rows_of(phase)
        left = self.rows_in.get(phase, 0) - so_far
        rows = so_far + self.rng.uniform(0, _SHARE_OF_ROWS) * left if left else math.inf
        return Due(phase, now_s + self.rng.uniform(0, _DELAY_S[phase]), rows)

    def _look_at(self, fault: Fault) -> None:
        if fault.kind == "same robot twice":
            answer = refused(self._site.twins[-1])
            if answer is None:
                return
            fault.note = "refused" if answer else "NOT refused"
        elif (fault.kind in ("weights cut", "frame cut") and self._site.proxy.is_armed) or self._site.later:
            return
        elif fault.target not in ("broker", *self._recorder.waiting_for) and fault.target in self._site.launcher.pids:
            self._open = None  # it has left: there is nothing more to come from it
            return
        elif self._count(fault) <= self._before:
            return
        fault.recovery_s, self._open = self._recorder.elapsed_s - fault.at_s, None

    def _count(self, fault: Fault) -> int:
        """Rows so far of whom the fault was done to."""
        if fault.target.startswith("agent-"):
            return sum(f"agent-{row.agent}" == fault.target for row in self._rows)
        return sum(row.agent == 0 for row in self._rows) if fault.target == "datacenter" else len(self._rows)


def plan_faults(count: int, kinds: Sequence[FaultKind], has_meta: bool) -> list[Fault]:
    """`count` faults, every kind in every phase in turn."""
    phases = PHASES if has_meta else (PHASES[0], PHASES[2])
    pairs = [(kind, phase) for kind in kinds for phase in phases if _makes_sense(kind, phase, has_meta)]
    chosen = [pairs[index % len(pairs)] for index in range(count)]
    return [Fault(kind, phase) for kind, phase in chosen]


def run_chaos(
    scenario: Scenario,
    options: list[str],
    out: Path,
    faults: int,
    seed: int,
    pause_s: float,
    kinds: Sequence[FaultKind],
    console: Console,
) -> list[Fault]:
    """Inject `faults` faults into as many runs as it takes; what was done, and whether it changed anything."""
    rng = random.Random(seed)
    run_deployment(scenario, "undisturbed", out, console, Options(restarts=0))
    expected = outcome(out / "undisturbed")
    rows_in = Counter(_PHASE_OF[row["phase"]] for row in expected[0])
    left = plan_faults(faults, kinds, bool(scenario.meta_methods))
    done: list[Fault] = []
    idle = 0
    for number in itertools.count(1):
        chaos = Chaos(scenario, options, f"disturbed-{number}", left, pause_s, rng, rows_in)
        run_deployment(scenario, chaos.run, out, console, Options(restarts=_RESTARTS, intruder=chaos))
        identical = outcome(out / chaos.run) == expected
        found = conservation(load_run(out / chaos.run).meter_rows)
        if processors(out / chaos.run) != processors(out / "undisturbed"):
            console.print(f"{chaos.run} was not computed on what the undisturbed run was; see their manifests")
        for fault in chaos.done:
            fault.identical, fault.conserved = identical, found is not None and not found.broken
        done += chaos.done
        with usable("--out", out, RunError):
            (out / CSV).write_text(chaos_csv(done), encoding="utf-8")
        idle = 0 if chaos.done else idle + 1
        if not left or idle == _IDLE_RUNS:  # they are too short for what is left
            break
    return done


def outcome(path: Path) -> tuple[list[dict[str, Any]], dict[str, bytes]]:
    """What must not depend on faults: all rows but what tells of time (a timed beta too) and refusals; all weights."""
    rows = [json.loads(line) for line in (path / "rounds.jsonl").read_text(encoding="utf-8").splitlines()]
    figures = [{key: value for key, value in row.items() if key not in _OF_TIME} for row in rows]
    return figures, {file.name: file.read_bytes() for file in sorted((path / "weights").iterdir())}


def processors(path: Path) -> set[str]:
    """All that a run was computed on."""
    noted = computed_on(json.loads((path / MANIFEST).read_text(encoding="utf-8")))
    return {processor for each in noted.values() for processor in each}


def chaos_table(faults: Sequence[Fault]) -> Table:
    """One row a fault."""
    identical = sum(fault.identical is True for fault in faults)
    table = Table(title=f"{len(faults)} faults, {identical} of them in runs with an identical end", box=box.SIMPLE)
    for heading in ("run", "phase", "fault", "done to", "recovery, s", "identical", "bytes fit", ""):
        table.add_column(heading, justify="right" if heading.endswith(" s") else "left")
    for fault in faults:
        recovery = "-" if fault.recovery_s is None else f"{fault.recovery_s:.1f}"
        said = [{True: "yes", False: "NO", None: "?"}[each] for each in (fault.identical, fault.conserved)]
        table.add_row(fault.run, fault.phase, fault.kind, fault.target, recovery, *said, fault.note)
    return table


def _makes_sense(kind: FaultKind, phase: str, has_meta: bool) -> bool:
    if kind == "weights cut":
        return phase == "federated"
    if kind == "frame cut":
        return phase == "meta-learning"
    if kind == "duplicates":
        return phase != "starting"
    return kind != "data center killed" or has_meta


__all__ = ["KINDS", "Fault", "chaos_table", "outcome", "plan_faults", "run_chaos"]


def chaos_csv(faults: Sequence[Fault]) -> str:
    """The table for programs."""
    rows = ["run,phase,fault,target,at_s,recovery_s,identical,bytes_fit,note"]
    for each in faults:
        recovery = "" if each.recovery_s is None else f"{each.recovery_s:.2f}"
        cells = (each.run, each.phase, each.kind, each.target, f"{each.at_s:.2f}", recovery)
        rows.append(",".join((*cells, str(each.identical), str(each.conserved), each.note)))
    return "\n".join(rows) + "\n"
