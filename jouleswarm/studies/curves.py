"""What share of tasks each arm had learned by what it had spent, over seeds and tasks.

Share and interquartile mean of the scores 0 and 1 of all seeds and tasks, with intervals by stratified bootstrap: of
each task its seeds are drawn again (Agarwal et al. 2021, Deep RL at the edge of the statistical precipice). The share
is their performance profile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.curves import until
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.items import BITS_PER_BYTE
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.table import Cell, Table
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import facts_of, runs_of, task_stages
from jouleswarm.studies.style import COLOURS

SPENT = {"joules": "joules", "bits": "bits on all links", "gradients": "batch gradients", "motions": "motions"}
"""What is spent, and what it is called."""
_BUDGETS = 40
_DRAWS = 1000

Band = NDArray[np.float64]
"""[3, budgets] a statistic and its middle 95%."""


class Profile(NamedTuple):
    """An arm at each budget."""

    share: Band
    iqm: Band


def to_learn(facts: Sequence[Fact], arm: str, energy: Energy) -> dict[str, NDArray[np.float64]]:
    """For each of `SPENT` [seeds, tasks] what the arm had spent, on all tasks, when a task was learned.

    Infinite where it was not learned. Clusters learn side by side, as in `energy.curves`.
    """
    found: dict[str, list[list[float]]] = {what: [] for what in SPENT}
    for run in runs_of(facts, "", arm).values():
        held = facts_of(run)
        learned = {fact.task: fact.learned for fact in task_stages(run)}
        points = {task: until(held, rounds) for task, rounds in held.rounds.items() if learned[task]}
        for what, total in spending(energy).items():
            found[what].append([total(points[task]) if task in points else math.inf for task in sorted(learned)])
    return {what: np.array(rows) for what, rows in found.items()}


def spending(energy: Energy) -> dict[str, Callable[[Facts], float]]:
    """Totals of an arm's facts by what is spent; joules are NaN where the equations have no bill for these facts."""

    def joules(facts: Facts) -> float:
        bill = price(literal, facts, energy)
        return math.nan if bill is None else bill.total_j

    def of(*names: str, unit: float = 1) -> Callable[[Facts], float]:
        return lambda facts: (
            unit * sum(getattr(counts, name) for counts in (facts.counts.ml, facts.counts.fl) for name in names)
        )

    bits = of("uplink_bytes", "downlink_bytes", "sidelink_bytes", unit=BITS_PER_BYTE)
    gradients = of("gradients_support", "gradients_query", "gradients_robots")
    return dict(zip(SPENT, (joules, bits, gradients, of("motions", "evaluation_motions")), strict=True))


def profile(costs: NDArray[np.float64], budgets: NDArray[np.float64]) -> Profile:
    """Share and interquartile mean of tasks learned within each budget.

    Args:
        costs: [seeds, tasks] what it took to learn each.
        budgets: [n] ascending.
    """
    seeds, tasks = costs.shape
    rng = np.random.default_rng(1)
    drawn = rng.multinomial(seeds, np.full(seeds, 1 / seeds), size=(_DRAWS, tasks))  # how often each seed, by task
    learned = (costs.T.reshape(-1, 1) <= budgets).astype(float)  # [tasks x seeds, budgets]
    counts = np.vstack([learned.sum(0), drawn.reshape(_DRAWS, -1).astype(float) @ learned])
    if seeds < 2:
        counts[1:] = math.nan  # one seed has no interval
    return Profile(_band(counts / (seeds * tasks)), _band(_interquartile(counts, seeds * tasks)))


def _interquartile(ones: NDArray[np.float64], among: int) -> NDArray[np.float64]:
    """Mean of the middle half of `among` scores, of which so many are 1 and the others 0."""
    cut = among // 4
    return np.clip(ones - cut, 0, among - 2 * cut) / (among - 2 * cut)


def _band(values: NDArray[np.float64]) -> Band:
    """Of [1 + draws, budgets], the first row that of the seeds as they are."""
    return np.vstack([values[0], np.quantile(values[1:], [0.025, 0.975], axis=0)])


def _profiles(facts: Sequence[Fact], arms: Mapping[int, str], energy: Energy) -> dict[str, tuple[Band, list[Profile]]]:
    """By what is spent: budgets that all arms share, from the least to the most that a task took; an arm's each."""
    costs, found = [to_learn(facts, arm, energy) for arm in arms.values()], {}
    for what in SPENT:
        told = np.concatenate([each[what].ravel() for each in costs])
        told = told[np.isfinite(told) & (told > 0)]
        if len(told):
            budgets = np.geomspace(told.min(), told.max(), _BUDGETS)
            found[what] = budgets, [profile(each[what], budgets) for each in costs]
    return found


def curves_csv(facts: Sequence[Fact], arms: Mapping[int, str], energy: Energy) -> Table:
    """A row for each thing that is spent, arm and budget; `arms` are by their t0."""
    rows: list[tuple[Cell, ...]] = []
    for what, (budgets, profiles) in _profiles(facts, arms, energy).items():
        for t0, each in zip(arms, profiles, strict=True):
            for place, budget in enumerate(budgets):
                cells = [None if math.isnan(value) else float(value) for band in each for value in band[:, place]]
                rows.append((what, t0, float(budget), *cells))
    names = [name for of in ("share", "iqm") for name in (of, f"{of}_low95", f"{of}_high95")]
    return Table("Tasks learned by what was spent", ("spent", "t0", "budget", *names), rows)


def curves_figure(facts: Sequence[Fact], arms: Mapping[int, str], energy: Energy) -> Figure:
    """The interquartile mean of tasks learned with its band over the share, against what was spent; an arm a colour."""
    found = _profiles(facts, arms, energy)
    figure = new_figure(4.4)
    grid = figure.subplots(2, max(1, len(found)), sharex="col", sharey=True, squeeze=False)
    for column, (what, (budgets, profiles)) in enumerate(found.items()):
        for place, (t0, each) in enumerate(zip(arms, profiles, strict=True)):
            for axes, band in ((grid[0][column], each.iqm), (grid[1][column], each.share)):
                look = {"color": COLOURS[place % len(COLOURS)], "linewidth": 0}
                axes.fill_between(budgets, 100 * band[1], 100 * band[2], step="post", alpha=0.2, **look)
                label = ("without" if t0 == 0 else f"$t_0$ = {t0}") if (axes, column) == (grid[0][0], 0) else None
                axes.step(budgets, 100 * band[0], where="post", **(look | {"linewidth": 1.2}), label=label)
        grid[1][column].set_xscale("log")
        grid[1][column].xaxis.set_minor_formatter(NullFormatter())
        grid[1][column].set_xlabel(SPENT[what])
    for axes, told in zip(
        grid[:, 0], ("tasks learned (%),\ninterquartile mean", "tasks learned (%),\nshare"), strict=True
    ):
        axes.set_ylabel(told)
    figure.legend(loc="outside upper center", ncols=len(arms), columnspacing=1.0, handlelength=1.5)
    return figure
