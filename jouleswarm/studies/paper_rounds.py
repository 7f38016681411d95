"""Table II again, and the tasks seen in meta-training against those unseen."""

from __future__ import annotations

from collections.abc import Sequence
from math import fsum

from jouleswarm.report.table import Cell, Table
from jouleswarm.runs.paper import TABLE_II
from jouleswarm.studies.arms import MEASURES, Measure, arms_by_t0, failures_of, rounds_estimate, tasks_of
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.tables import estimate_text, failures_text, spread

_PRINTED_TASKS = (1, 2, 3, 4, 5, 6)
_MEASURE_TITLES = {
    "rounds": "R averaged over the scenario's reward window",
    "rounds_first": "the first round in which the cluster's mean reward reached the target",
    "rounds_w3": "rewards averaged over the last 3 rounds",
}
_CENSORED = "A task that was not learned counts as the rounds it ran, so means with such are lower bounds."


def table_2_csv(facts: Sequence[Fact]) -> Table:
    """t_i over seeds for every t0 and task and their sum, by each measure, beside the printed Table II."""
    tasks = tasks_of(facts)
    return _rounds_csv(facts, "task", [*((str(task), (task,)) for task in tasks), ("sum", tasks)])


def table_2_markdown(facts: Sequence[Fact]) -> list[Table]:
    """The same for readers, a table a measure; the printed values stand in brackets."""
    return [_by_measure(facts, measure) for measure in MEASURES]


def seen_unseen_csv(facts: Sequence[Fact], training: Sequence[int]) -> Table:
    """Rounds summed over tasks seen in meta-training, and over the unseen, beside the printed sums."""
    return _rounds_csv(facts, "tasks", _groups(facts, training))


def seen_unseen_markdown(facts: Sequence[Fact], training: Sequence[int]) -> list[Table]:
    """The same for readers, by the scenario's own reward window."""
    groups = _groups(facts, training)
    rows: list[tuple[Cell, ...]] = []
    for t0, arm in arms_by_t0(facts).items():
        cells: list[Cell] = [t0]
        for _, of in groups:
            cells.append(_cell(facts, t0, arm, of, "rounds"))
            cells.append(failures_text(*failures_of(facts, "", arm, of)))
        rows.append(tuple(cells))
    named = [f"{name} ({', '.join(map(str, of))})" for name, of in groups]
    headings = ("t0", *(heading for name in named for heading in (name, "not learned")))
    return [Table("Rounds summed over seen and unseen tasks (printed)", headings, rows, (_CENSORED,))]


def _rounds_csv(facts: Sequence[Fact], what: str, groups: Sequence[tuple[str, tuple[int, ...]]]) -> Table:
    """A row a measure, t0 and group of tasks."""
    rows: list[tuple[Cell, ...]] = []
    for measure in MEASURES:
        for t0, arm in arms_by_t0(facts).items():
            for name, of in groups:
                found = rounds_estimate(facts, arm, of, measure)
                counted = (found.n, *failures_of(facts, "", arm, of), _printed(t0, of, tasks_of(facts)))
                rows.append((measure, t0, name, *spread(found), *counted))
    return Table("", ("measure", "t0", what, "rounds", "ci95", "seeds", "not_learned", "trials", "printed"), rows)


def _by_measure(facts: Sequence[Fact], measure: Measure) -> Table:
    tasks = tasks_of(facts)
    rows: list[tuple[Cell, ...]] = []
    for t0, arm in arms_by_t0(facts).items():
        cells = [_cell(facts, t0, arm, of, measure) for of in (*((task,) for task in tasks), tasks)]
        rows.append((t0, *cells, failures_text(*failures_of(facts, "", arm, tasks))))
    headings = ("t0", *(f"t_{task}" for task in tasks), "sum", "not learned")
    return Table(f"Rounds t_i (printed): {_MEASURE_TITLES[measure]}", headings, rows, (_CENSORED,))


def _cell(facts: Sequence[Fact], t0: int, arm: str, of: Sequence[int], measure: Measure) -> str:
    printed = _printed(t0, of, tasks_of(facts))
    text = estimate_text(rounds_estimate(facts, arm, of, measure))
    return text if printed is None else f"{text} ({printed:.1f})"


def _groups(facts: Sequence[Fact], training: Sequence[int]) -> list[tuple[str, tuple[int, ...]]]:
    tasks = tasks_of(facts)
    groups = [
        ("seen", tuple(task for task in tasks if task in training)),
        ("unseen", tuple(task for task in tasks if task not in training)),
    ]
    return [(name, of) for name, of in groups if of]


def _printed(t0: int, of: Sequence[int], tasks: Sequence[int]) -> float | None:
    """The printed sum over tasks, where these are the paper's six tasks and t0 one of its."""
    if t0 not in TABLE_II or tuple(tasks) != _PRINTED_TASKS:
        return None
    return fsum(TABLE_II[t0][task - 1] for task in of)
