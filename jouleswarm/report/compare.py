"""`jouleswarm compare`: runs side by side, and in what their scenarios differ."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import Any

from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.mistakes import short
from jouleswarm.common.scenario.reading import Override
from jouleswarm.energy.items import BITS_PER_BYTE
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price, with_beta
from jouleswarm.energy.repricing import reprice
from jouleswarm.energy.times import times
from jouleswarm.report.arms import method_label
from jouleswarm.report.format import joules_text
from jouleswarm.report.table import Cell, Table, number
from jouleswarm.runs.directory import TIMES
from jouleswarm.runs.run import Run, load_run


@dataclass(frozen=True)
class ArmAtAGlance:
    """What an arm took."""

    label: str
    rounds: int
    """Of all tasks together."""
    learned: int
    """Tasks."""
    joules: float | None
    """By the equations."""
    bits: float | None
    """On all links; None where they were not metered."""
    seconds: float | None
    """Until the last task was learned, by computing times and link rates; None where a rate is not given."""
    computing_s: float | None
    """What of them is computing."""


@dataclass(frozen=True)
class Compared:
    """Runs, each with its arms, and field -> its value in each run, of fields that differ."""

    runs: Sequence[Run]
    arms: Sequence[Mapping[str, ArmAtAGlance]]
    clock_s: Sequence[float | None]
    """From the first row to the last, by the recorder's clock."""
    differences: Mapping[str, Sequence[object]]


def compared(paths: Sequence[Path], changes: Sequence[Override] = ()) -> Compared:
    """Read runs; `changes` of the section energy hold for all of them.

    Raises:
        ConfigurationError: fewer than two, more than letters, or no run directory.
        RunError: one is damaged.
    """
    if not 2 <= len(paths) <= len(ascii_uppercase):
        raise ConfigurationError(f"got {len(paths)} run, expected 2 to {len(ascii_uppercase)} run directories")
    runs = []
    for path in paths:
        run = load_run(path)
        priced, _ = reprice(run.scenario, changes, str(path))
        runs.append(run.at(priced))
    flat = [dict(_flat("", run.scenario.model_dump(mode="json"))) for run in runs]
    names = dict.fromkeys(name for each in flat for name in each)
    values = {name: [each.get(name) for each in flat] for name in names}
    differences = {name: held for name, held in values.items() if any(each != held[0] for each in held)}
    return Compared(runs, [_arms(run) for run in runs], [_clock_s(run) for run in runs], differences)


def compare_table(found: Compared) -> Table:
    """A row an arm and quantity, a column a run; of two runs the second over the first too."""
    rows: list[list[Cell]] = []
    for name in dict.fromkeys(name for arms in found.arms for name in arms):
        held = [arms.get(name) for arms in found.arms]
        label = next(arm.label for arm in held if arm is not None)
        for what, key, text in _QUANTITIES:
            values = [None if arm is None else getattr(arm, key) for arm in held]
            if any(value is not None for value in values):
                rows.append(_row(f"{label}: {what}", values, text))
    rows.append(_row("all: seconds by the clock", found.clock_s, number))
    letters = _letters(found)
    return Table("Side by side", ["", *letters, *(["B / A"] if len(letters) == 2 else [])], rows, _NOTES)


def compare_lines(found: Compared) -> Iterator[str]:
    """Which run each letter is, and in what the scenarios differ."""
    for letter, run in zip(_letters(found), found.runs, strict=True):
        yield f"{letter}: {run.path} ({run.scenario.name}, seed {run.scenario.seed}, {run.status})"
    if not found.differences:
        yield "Their scenarios are the same."
        return
    yield "Their scenarios differ in:"
    for name, values in found.differences.items():
        told = (f"{letter} {_told(value)}" for letter, value in zip(_letters(found), values, strict=True))
        yield f"  {name}: {', '.join(told)}"


def compare_document(found: Compared) -> dict[str, Any]:
    """The same as plain data; values of `differences` are in the order of `runs`."""
    runs = [
        {
            "path": str(run.path),
            "scenario": run.scenario.name,
            "seed": run.scenario.seed,
            "status": run.status,
            "clock_s": clock_s,
            "arms": {name: asdict(arm) for name, arm in arms.items()},
        }
        for run, arms, clock_s in zip(found.runs, found.arms, found.clock_s, strict=True)
    ]
    return {"runs": runs, "differences": dict(found.differences)}


def _arms(run: Run) -> dict[str, ArmAtAGlance]:
    found = {}
    for arm in run.scenario.arms:
        facts, results = run.facts[arm.name], run.results[arm.name]
        energy = with_beta(run.scenario.energy, facts)
        bill = price(literal, facts, run.scenario.energy) if facts.metered else None
        counts, took = facts.counts.ml + facts.counts.fl, times(facts, energy).total
        label = method_label(run.scenario, arm.method)
        found[arm.name] = ArmAtAGlance(
            label=label if arm.name == arm.method else f"{label}, t0 = {arm.t0}",
            rounds=sum(result.rounds for result in results),
            learned=sum(result.learned for result in results),
            joules=None if bill is None else bill.total_j,
            bits=BITS_PER_BYTE * (counts.uplink_bytes + counts.downlink_bytes + counts.sidelink_bytes)
            if facts.metered
            else None,
            seconds=took.total_s,
            computing_s=took.computing_s,
        )
    return found


def _clock_s(run: Run) -> float | None:
    at = [json.loads(line)["time_s"] for line in whole_lines(run.path / TIMES, mend=False)]
    return max(at) - min(at) if at else None


def _flat(place: str, value: Any) -> Iterator[tuple[str, object]]:
    """(dotted name, value) of everything in a scenario; tasks by their place."""
    if isinstance(value, Mapping) and value:
        for name, each in value.items():
            yield from _flat(f"{place}.{name}" if place else str(name), each)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for number_, each in enumerate(value):
            yield from _flat(f"{place}.{number_}", each)
    else:
        yield place, value


def _row(what: str, values: Sequence[Any], text: Callable[[Any], str]) -> list[Cell]:
    cells: list[Cell] = [None if value is None else text(value) for value in values]
    if len(values) != 2:
        return [what, *cells]
    first, second = values
    return [what, *cells, None if not first or second is None else f"{second / first:.3g}"]


def _bits_text(bits: float) -> str:
    return next((f"{bits / size:.4g} {unit}" for unit, size in _BITS if bits >= size), f"{bits:.0f} bit")


def _told(value: object) -> str:
    return "another" if isinstance(value, str) and "\n" in value else "unset" if value is None else short(value)


def _letters(found: Compared) -> str:
    return ascii_uppercase[: len(found.runs)]


_BITS = (("Gbit", 1e9), ("Mbit", 1e6), ("kbit", 1e3))
_QUANTITIES: tuple[tuple[str, str, Callable[[Any], str]], ...] = (
    ("rounds", "rounds", str),
    ("tasks learned", "learned", str),
    ("joules", "joules", joules_text),
    ("bits", "bits", _bits_text),
    ("seconds", "seconds", number),
    ("seconds computing", "computing_s", number),
)
_NOTES = (
    "Rounds of all tasks together; joules by the equations, bits on all links, seconds until the last task was "
    "learned, by computing times and link rates.",
)
