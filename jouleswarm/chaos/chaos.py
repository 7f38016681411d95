"""`jouleswarm chaos`: does a fault change anything but the clock? Runs a scenario undisturbed, then with faults."""

from __future__ import annotations

import contextlib
import itertools
import json
import random
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from jouleswarm.chaos.faults import FaultKind
from jouleswarm.chaos.intruder import PHASE_OF, Chaos
from jouleswarm.chaos.plan import Fault, plan_faults
from jouleswarm.chaos.ramdisk import RamDisk, ram_disk
from jouleswarm.chaos.scenes import ENDED_BY_AN_ERROR, between, is_due_to
from jouleswarm.chaos.table import chaos_csv
from jouleswarm.common.errors import RunError, usable
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.fleet.deploy import Options, resume_deployment, run_deployment
from jouleswarm.report.view import View
from jouleswarm.runs.conservation import conservation
from jouleswarm.runs.directory import MANIFEST, computed_on
from jouleswarm.runs.run import load_run

_RESTARTS = 1000
_IDLE_RUNS = 3
CSV = "chaos.csv"
_OF_TIME = ("seconds", "refused", "beta")
"""Of a row. `beta` is there only where it was measured, by time."""


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
    run_deployment(scenario, "undisturbed", out, console, Options(restarts=0, view=View))
    expected = outcome(out / "undisturbed")
    rows_in = Counter(PHASE_OF[row["phase"]] for row in expected[0])
    left = plan_faults(faults, kinds, bool(scenario.meta_methods))
    done: list[Fault] = []
    idle = 0
    for number in itertools.count(1):
        chaos = Chaos(scenario, options, out / f"disturbed-{number}", left, pause_s, rng, rows_in, idle=idle)
        with _disk_for(chaos) as chaos.disk:
            _run_disturbed(chaos, console)
        identical = outcome(chaos.path) == expected
        found = conservation(load_run(chaos.path).meter_rows)
        if processors(chaos.path) != processors(out / "undisturbed"):
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


def _disk_for(chaos: Chaos) -> contextlib.AbstractContextManager[RamDisk | None]:
    """A disk of its own for a run whose disk may be filled."""
    is_to_fill = any(fault.kind in ENDED_BY_AN_ERROR for fault in chaos.plan)
    return ram_disk(chaos.path) if is_to_fill else contextlib.nullcontext()


def _run_disturbed(chaos: Chaos, console: Console) -> None:
    """One run from its beginning to its end, gone on with as often as a fault ends it."""
    options = Options(restarts=_RESTARTS, intruder=chaos, view=View)
    resume = partial(resume_deployment, chaos.path, console, options)
    go_on = partial(run_deployment, chaos.scenario, chaos.run, chaos.path.parent, console, options)
    while True:
        try:
            go_on()
            return
        except (KeyboardInterrupt, RunError) as end:
            fault, chaos.ending = chaos.ending, None
            if fault is None or not is_due_to(fault, end):
                raise
            if chaos.disk is not None:
                chaos.disk.make_room()
            between(fault, end, chaos.path, resume)
            go_on = resume


def outcome(path: Path) -> tuple[list[dict[str, Any]], dict[str, bytes]]:
    """What must not depend on faults: all rows but what tells of time (a timed beta too) and refusals; all weights."""
    rows = [json.loads(line) for line in (path / "rounds.jsonl").read_text(encoding="utf-8").splitlines()]
    figures = [{key: value for key, value in row.items() if key not in _OF_TIME} for row in rows]
    return figures, {file.name: file.read_bytes() for file in sorted((path / "weights").iterdir())}


def processors(path: Path) -> set[str]:
    """All that a run was computed on."""
    noted = computed_on(json.loads((path / MANIFEST).read_text(encoding="utf-8")))
    return {processor for each in noted.values() for processor in each}


def wrapping(scenario: Scenario) -> list[str]:
    """Overrides that make the memories of motions so small that what is new is written over the old after two rounds.

    Beside the memory there are two rounds more in a file (see `learning.replay`).
    """
    motions, sizes = scenario.learning.motions_per_round, (scenario.learning.replay_size, scenario.meta.replay_size)
    small = [max(3, min(size, motions)) for size in sizes]
    return [f"learning.replay_size={small[0]}", f"meta.replay_size={small[1]}"]
