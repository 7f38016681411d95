"""Whether what was learned is an estimate of returns at all."""

from __future__ import annotations

from jouleswarm.report.arms import labels
from jouleswarm.runs.run import Run


def values_that_ran_away(run: Run) -> list[str]:
    """A line an arm whose robots acted on values that no rewards add up to; none where there is no such arm."""
    lines = []
    for arm, label in labels(run.scenario).items():
        rows = [row for row in run.rows if row.arm == arm and row.ran_away is not None]
        if not rows:
            continue
        tasks, rounds = sorted({row.task for row in rows}), [row.round for row in rows]
        named = f"task{'s' if len(tasks) > 1 else ''} {', '.join(map(str, tasks))}"
        largest = max(row.ran_away for row in rows if row.ran_away is not None)
        lines.append(
            f"Values have run away: {label}, {named}, in rounds {min(rounds)} to {max(rounds)}, mean |Q| up to "
            f"{largest:.2g}, far beyond any return of the rewards there. The rounds of that arm tell of this, and not "
            "of its method: have it learn more slowly (learning.lr, meta.meta_lr), with targets that follow more "
            "slowly, or see more (epsilon and starts of learning and meta)."
        )
    return lines
