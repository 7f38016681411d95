"""Table II again, and the tasks seen in meta-training against those unseen."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import fsum

from jouleswarm.report.table import Cell, Table
from jouleswarm.runs.paper import TABLE_II
from jouleswarm.studies.arms import (
    MEASURES,
    Line,
    Measure,
    by_full_window,
    copied_share,
    failures_of,
    groups_of,
    lines_of,
    rounds_estimate,
    tasks_of,
    zero_shot_share,
)
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.tables import at_least, estimate_text, failures_text, spread

_PRINTED_TASKS = (1, 2, 3, 4, 5, 6)
_MEASURE_TITLES = {
    "rounds": "R averaged over the scenario's reward window",
    "rounds_first": "the first round in which the cluster's mean reward reached the target",
    "rounds_w3": "rewards averaged over the last 3 rounds",
}
_CENSORED = "A task that was not learned counts as the rounds it ran, so means with such are lower bounds (≥)."
_COPIED = "Zero-shot: learned in round 0. Copied: the cluster's mean reward at the target in round 0 or 1."


def table_2_csv(facts: Sequence[Fact], window: int) -> Table:
    """t_i over seeds for every t0 and task and their sum, by each measure, beside the printed Table II.

    Args:
        facts: of the study.
        window: rounds that R is averaged over; t_i by all of them stand beside those that were counted.
    """
    tasks = tasks_of(facts)
    return _rounds_csv(facts, window, "task", [*((str(task), (task,)) for task in tasks), ("sum", tasks)])


def table_2_markdown(facts: Sequence[Fact], window: int) -> list[Table]:
    """The same for readers, a table a measure; the printed values stand in brackets."""
    return [_by_measure(facts, measure, window) for measure in MEASURES]


def seen_unseen_csv(facts: Sequence[Fact], training: Sequence[int], window: int) -> Table:
    """Rounds summed over tasks seen in meta-training, and over the unseen, beside the printed sums."""
    return _rounds_csv(facts, window, "tasks", _groups(facts, training))


def seen_unseen_markdown(facts: Sequence[Fact], training: Sequence[int], window: int) -> list[Table]:
    """The same for readers, by the scenario's own reward window: as counted, and by the full window."""
    groups, full = _groups(facts, training), by_full_window(facts, window)
    rows: list[tuple[Cell, ...]] = []
    for line in lines_of(facts):
        cells: list[Cell] = [line.method, line.t0]
        for _, of in groups:
            failed = failures_of(facts, "", line.arm, of)
            cells.append(_cell(facts, line, of, "rounds"))
            cells.append(at_least(estimate_text(rounds_estimate(full, line.arm, of)), failed[0]))
            shares = (_share_text(share(facts, line.arm, of)) for share in (_zero_shot, _copied))
            cells += [*shares, failures_text(*failed)]
        rows.append(tuple(cells))
    named = [f"{name} ({', '.join(map(str, of))})" for name, of in groups]
    told = ("full window", "zero-shot", "copied", "not learned")
    headings = ("method", "t0", *(heading for name in named for heading in (name, *told)))
    notes = (_CENSORED, _full_note(window), _COPIED)
    return [Table("Rounds summed over unseen and seen tasks (printed)", headings, rows, notes)]


def _rounds_csv(facts: Sequence[Fact], window: int, what: str, groups: Sequence[tuple[str, tuple[int, ...]]]) -> Table:
    """A row a measure, t0 and group of tasks; by the full window beside the rounds that R's own measure counted."""
    rows: list[tuple[Cell, ...]] = []
    full = by_full_window(facts, window)
    for measure in MEASURES:
        for line in lines_of(facts):
            for name, of in groups:
                found = rounds_estimate(facts, line.arm, of, measure)
                counted = (found.n, *failures_of(facts, "", line.arm, of), _printed(line, of, tasks_of(facts)))
                by_full = spread(rounds_estimate(full, line.arm, of) if measure == "rounds" else None)
                shares = (_zero_shot(facts, line.arm, of), _copied(facts, line.arm, of))
                rows.append((measure, line.method, line.t0, name, *spread(found), *by_full, *counted, *shares))
    headings = ("rounds", "ci95", "full_window", "full_ci95", "seeds", "not_learned", "trials", "printed", "zero_shot")
    return Table("", ("measure", "method", "t0", what, *headings, "copied"), rows)


def _by_measure(facts: Sequence[Fact], measure: Measure, window: int) -> Table:
    tasks, full = tasks_of(facts), by_full_window(facts, window) if measure == "rounds" else None
    rows: list[tuple[Cell, ...]] = []
    for line in lines_of(facts):
        cells = [_cell(facts, line, of, measure) for of in (*((task,) for task in tasks), tasks)]
        failed = failures_of(facts, "", line.arm, tasks)
        by_full = [at_least(estimate_text(rounds_estimate(full, line.arm, tasks)), failed[0])] if full else []
        shares = (_share_text(share(facts, line.arm, tasks)) for share in (_zero_shot, _copied))
        rows.append((line.method, line.t0, *cells, *by_full, *shares, failures_text(*failed)))
    told = ["sum", *(["sum, full window"] if full else [])]
    headings = ("method", "t0", *(f"t_{task}" for task in tasks), *told, "zero-shot", "copied", "not learned")
    notes = (_CENSORED, *([_full_note(window)] if full else []), _COPIED)
    return Table(f"Rounds t_i (printed): {_MEASURE_TITLES[measure]}", headings, rows, notes)


def _zero_shot(facts: Sequence[Fact], arm: str, of: Collection[int]) -> float | None:
    return zero_shot_share(fact for fact in facts if fact.arm == arm and fact.task in of)


def _copied(facts: Sequence[Fact], arm: str, of: Collection[int]) -> float | None:
    return copied_share(fact for fact in facts if fact.arm == arm and fact.task in of)


def _share_text(share: float | None) -> str:
    return "-" if share is None else f"{share:.0%}"


def _full_note(window: int) -> str:
    return f"Full window: t_i >= {window}, the rounds that R is averaged over, also where robots stopped on fewer."


def _cell(facts: Sequence[Fact], line: Line, of: Sequence[int], measure: Measure) -> str:
    printed = _printed(line, of, tasks_of(facts))
    text = estimate_text(rounds_estimate(facts, line.arm, of, measure))
    text = at_least(text, failures_of(facts, "", line.arm, of)[0])
    return text if printed is None else f"{text} ({printed:.1f})"


def _groups(facts: Sequence[Fact], training: Sequence[int]) -> list[tuple[str, tuple[int, ...]]]:
    """The unseen tasks first."""
    return [(name, of) for name, of in groups_of(facts, training).items() if name != "all"]


def _printed(line: Line, of: Sequence[int], tasks: Sequence[int]) -> float | None:
    """The printed sum over tasks, where these are the paper's six tasks and t0 one of its."""
    if line.t0 not in TABLE_II or tuple(tasks) != _PRINTED_TASKS:
        return None
    return fsum(TABLE_II[line.t0][task - 1] for task in of)
