"""Files of `benchmarks.tuning`: every unit's row, and what has come out method by method."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.tuning_ranges import BASELINE, METHODS, PAPERS, SCREENED, SEEDS, Tuned
from jouleswarm.report.table import Cell
from jouleswarm.studies.estimates import estimate


class Row(NamedTuple):
    """What one unit gave; rounds are sums over tasks."""

    method: str
    trial: int
    settings: str
    seed: int
    t0: int
    rounds: int
    rounds_first: int
    not_learned: int
    seen: int
    unseen: int
    cpu_s: float
    scenario: str
    """Digest of all that the outcome depends on but the code."""


class Outcome(NamedTuple):
    """What is known of a method: rows of its best trial on all seeds (none yet), and of the scenario's own settings."""

    tuned: Tuned
    best: list[Row]
    default: list[Row]
    units: int
    units_of: int
    cpu_s: float


def read_rows(path: Path) -> list[Row]:
    """Rows of an earlier start, if there was one."""
    if not path.exists():
        return []
    kinds = (str, int, str, int, int, int, int, int, int, int, float, str)
    with path.open(newline="", encoding="utf-8") as file:
        lines = list(csv.reader(file))[1:]
    return [Row(*(kind(cell) for kind, cell in zip(kinds, line, strict=True))) for line in lines]


def write_trials(path: Path, rows: Sequence[Row]) -> None:
    """All rows in a fixed order, whole or not at all."""
    order = [tuned.name for tuned in METHODS]
    ordered = sorted(rows, key=lambda row: (order.index(row.method), row.trial, row.seed, row.scenario))
    path.parent.mkdir(parents=True, exist_ok=True)
    half = path.with_suffix(".half")
    with half.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows((Row._fields, *ordered))
    os.replace(half, path)


_MEASURES = ("rounds", "rounds_first", "seen", "unseen")
_SPREAD = (*_MEASURES, "saved", "saved_unseen")
_ENDS = ("not_learned", "untuned", "units", "units_of", "cpu_h")
COLUMNS = ("row", "method", "settings", *(cell for name in _SPREAD for cell in (name, f"{name}_ci95")), *_ENDS)
"""`saved`: rounds of the arm without transfer less the method's, seed by seed; `untuned`: rounds of the first trial."""


def table_of(outcomes: Sequence[Outcome]) -> list[dict[str, Cell]]:
    """A line a method by `COLUMNS`: means over the six seeds and Student's 95% intervals."""
    baseline = {row.seed: row for each in outcomes if each.tuned.name == BASELINE for row in each.best}
    return [dict(zip(COLUMNS, _cells(each, baseline), strict=True)) for each in outcomes]


def _cells(outcome: Outcome, baseline: Mapping[int, Row]) -> Iterator[Cell]:
    best, tuned = outcome.best, outcome.tuned
    yield from (tuned.name, tuned.method, best[0].settings if best else None)
    for name in _MEASURES:
        yield from _spread([getattr(row, name) for row in best])
    pairs = [] if tuned.name == BASELINE else [(baseline[row.seed], row) for row in best if row.seed in baseline]
    yield from _spread([without.rounds - row.rounds for without, row in pairs])
    yield from _spread([without.unseen - row.unseen for without, row in pairs])
    yield sum(row.not_learned for row in best) if best else None
    yield estimate(row.rounds for row in outcome.default).mean if outcome.default else None
    yield from (outcome.units, outcome.units_of, round(outcome.cpu_s / 3600, 2))


def _spread(values: Sequence[float]) -> tuple[float | None, float | None]:
    found = estimate(values) if values else None
    return (None, None) if found is None else (round(found.mean, 3), found.ci95 and round(found.ci95, 3))


def write_table(path: Path, outcomes: Sequence[Outcome]) -> None:
    """The table for programs."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(table_of(outcomes))


def write_outcome(path: Path, outcomes: Sequence[Outcome], trials: int, t0: int, max_rounds: int) -> None:
    """The table for readers, and what was tried."""
    first, best, others = (
        ", ".join(map(str, each)) for each in (SEEDS[:SCREENED], [-(-trials // 4)], SEEDS[SCREENED:])
    )
    lines = [
        "# Every method tuned with the same budget", "",
        "By `python -m benchmarks.tuning`, from `trials.csv`.",
        f"Each method has {trials} trials from the ranges below, the first the scenario as it stands,",
        f"on seeds {first}; the best {best} go on to seeds {others}.",
        f"Ranked by rounds of all tasks together, full reward window, t0 = {t0};",
        f"a task that is not learned counts as {max_rounds}.",
        f"Robots have in every method the settings that were best for `{BASELINE}`.", "",
        "Means over the six seeds and Student's 95% intervals.",
        "Settings were chosen on these very seeds, which flatters all of them.",
        "Untuned: the first trial, on its two seeds.", "",
        "| method | best settings | rounds | minus `fl`, seed by seed | to the first success | tasks seen | unseen |"
        " not learned | untuned | units | CPU hours |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    lines += [_line(row) for row in table_of(outcomes)]
    lines += ["", "| method | setting | tried |", "|---|---|---|"]
    for tuned in METHODS:
        lines += [f"| {tuned.name} | `{name}` | {values} |" for name, values in tuned.ranges.items()]
        lines += [f"| {tuned.name} | `{each}` | fixed |" for each in tuned.fixed]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def _line(row: Mapping[str, Cell]) -> str:
    cells: list[Cell] = [
        row["row"],
        "not known yet" if row["settings"] is None else f"`{row['settings'] or 'as it stands'}`",
    ]
    saved = "-" if row["row"] == BASELINE else _told(row, "saved", -1)
    cells += [_told(row, "rounds"), saved, *(_told(row, name) for name in _MEASURES[1:]), row["not_learned"]]
    cells += ["" if row["untuned"] is None else f"{row['untuned']:.1f}", f"{row['units']} of {row['units_of']}"]
    return f"| {' | '.join('' if cell is None else str(cell) for cell in [*cells, row['cpu_h']])} |"


def _told(row: Mapping[str, Cell], name: str, sign: int = 1) -> str:
    mean, half = row[name], row[f"{name}_ci95"]
    if not isinstance(mean, float | int):
        return ""
    return f"{sign * mean:.1f}" + ("" if half is None else f" ± {half:.1f}")


def write_best(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Settings as `jouleswarm study --tuned` takes them, of what has been tuned to the end.

    Exact MAML has one head for all tasks, as the paper's; of first-order MAML's two rows the better one is taken.
    """
    done = {each.tuned.name: each for each in outcomes if each.best}
    robots = done[BASELINE].best[0].settings.split() if BASELINE in done else []
    rows = {each.tuned.method: each for each in sorted(done.values(), key=_rounds, reverse=True)}
    rows |= {PAPERS.method: done[PAPERS.name]} if PAPERS.name in done else {}
    lines = ["# By python -m benchmarks.tuning.", f"robots = {json.dumps(robots)}", "", "[methods]"]
    for method, outcome in sorted(rows.items()):
        if method != BASELINE:
            own = [each for each in outcome.best[0].settings.split() if each not in robots]
            lines.append(f"{method} = {json.dumps(own)}")
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def _rounds(outcome: Outcome) -> int:
    return sum(row.rounds for row in outcome.best)
