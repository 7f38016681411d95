"""Files of `benchmarks.tuning`: every unit's row, and what has come out method by method."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.tuning_ranges import BASELINE, METHODS, PAPERS, SCREENED, SEEDS, Tuned
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


def write_outcome(path: Path, outcomes: Sequence[Outcome], trials: int, t0: int, max_rounds: int) -> None:
    """The tables that docs are written from."""
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
    baseline = {row.seed: row.rounds for each in outcomes if each.tuned.name == BASELINE for row in each.best}
    lines += [_line(each, baseline) for each in outcomes]
    lines += ["", "| method | setting | tried |", "|---|---|---|"]
    for tuned in METHODS:
        lines += [f"| {tuned.name} | `{name}` | {values} |" for name, values in tuned.ranges.items()]
        lines += [f"| {tuned.name} | `{each}` | fixed |" for each in tuned.fixed]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


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


def _line(outcome: Outcome, baseline: dict[int, int]) -> str:
    best = outcome.best
    cells = [outcome.tuned.name, f"`{best[0].settings or 'as it stands'}`" if best else "not known yet"]
    if best:
        less = [float(row.rounds - baseline[row.seed]) for row in best if row.seed in baseline]
        cells += [_told([row.rounds for row in best]), _told(less) if outcome.tuned.name != BASELINE else "-"]
        cells += [
            _told([row[index] for row in best]) for index in map(Row._fields.index, ("rounds_first", "seen", "unseen"))
        ]
        cells.append(str(sum(row.not_learned for row in best)))
    else:
        cells += [""] * 6
    cells.append(f"{estimate(row.rounds for row in outcome.default).mean:.1f}" if outcome.default else "")
    cells += [f"{outcome.units} of {outcome.units_of}", f"{outcome.cpu_s / 3600:.2f}"]
    return f"| {' | '.join(cells)} |"


def _told(values: Sequence[float]) -> str:
    if not values:
        return ""
    found = estimate(values)
    return f"{found.mean:.1f}" + (f" ± {found.ci95:.1f}" if found.ci95 is not None else "")
