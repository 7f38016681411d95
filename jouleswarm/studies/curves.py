"""What share of tasks each arm had learned by what it had spent, over seeds and tasks.

Share and interquartile mean of the scores 0 and 1 of all seeds and tasks, with intervals by stratified bootstrap: of
each task its seeds are drawn again (Agarwal et al. 2021, Deep RL at the edge of the statistical precipice). The share
is their performance profile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.curves import until
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.items import BITS_PER_BYTE
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price, with_beta
from jouleswarm.energy.times import times
from jouleswarm.report.table import Cell, Table
from jouleswarm.runs.curves import SPENT
from jouleswarm.studies.arms import ArmOf, arms_by_variant
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import facts_of, runs_of, task_stages
from jouleswarm.studies.shares import shared_out

_BUDGETS = 40
_DRAWS = 1000

Spent = Callable[[float], float]
"""After so many rounds of every cluster."""
Band = NDArray[np.float64]
"""[3, budgets] a statistic and its middle 95%."""


class Profile(NamedTuple):
    """An arm at each budget."""

    share: Band
    iqm: Band


class Curves(NamedTuple):
    """Of all arms against one thing that is spent."""

    budgets: NDArray[np.float64]
    """[n] the same for all arms, from the least to the most that a task took."""
    arms: dict[ArmOf, Profile]
    """Those of which it is known what they had spent."""


def curves_of(facts: Sequence[Fact], scenario: Scenario) -> dict[str, Curves]:
    """By what is spent, of `SPENT`; without what is not known of any arm, or where nothing was learned.

    Args:
        facts: with motions.
        scenario: at whose prices, and by whose rates; seconds are known where it has any (`Energy.tells_time`).
    """
    costs = {
        arm: to_learn(runs_of(facts, arm.variant, arm.arm).values(), scenario)
        for arms in arms_by_variant(facts).values()
        for arm in arms
    }
    found = {}
    for what in SPENT:
        held = {arm: each[what] for arm, each in costs.items() if not np.isnan(each[what]).any()}
        told = np.concatenate([each.ravel() for each in held.values()] or [np.empty(0)])
        told = told[np.isfinite(told) & (told > 0)]
        if len(told):
            budgets = np.geomspace(told.min(), told.max(), _BUDGETS)
            found[what] = Curves(budgets, {arm: profile(each, budgets) for arm, each in held.items()})
    return found


def to_learn(runs: Collection[Sequence[Fact]], scenario: Scenario) -> dict[str, NDArray[np.float64]]:
    """For each of `SPENT` [seeds, tasks] what an arm had spent, on all tasks, when a task was learned.

    Infinite where it was not learned, NaN where what was spent is not known. Clusters learn side by side, as in
    `energy.curves`.
    """
    found: dict[str, list[list[float]]] = {what: [] for what in SPENT}
    for run in runs:
        sums, learned = facts_of(run), {fact.task: fact.learned for fact in task_stages(run)}
        rounds = {task: took for task, took in sums.rounds.items() if learned[task]}
        seconds = _seconds(run, scenario)
        for what, spent in (_spending(scenario.energy, sums) | {"seconds": seconds}).items():
            found[what].append([spent(rounds[task]) if task in rounds else math.inf for task in sorted(learned)])
    return {what: np.array(rows) for what, rows in found.items()}


def _spending(energy: Energy, sums: Facts) -> dict[str, Spent]:
    def of(*names: str, unit: float = 1) -> Spent:
        def spent(rounds: float) -> float:
            counts = until(sums, rounds).counts
            told: float = sum(getattr(each, name) for each in (counts.ml, counts.fl) for name in names)
            return unit * told

        return spent

    def joules(rounds: float) -> float:
        bill = price(literal, until(sums, rounds), energy)
        return math.nan if bill is None else bill.total_j

    return {
        "joules": joules,
        "bits": of("uplink_bytes", "downlink_bytes", "sidelink_bytes", unit=BITS_PER_BYTE),
        "gradients": of("gradients_support", "gradients_query", "gradients_robots"),
        "motions": of("motions", "evaluation_motions"),
    }


def _seconds(run: Sequence[Fact], scenario: Scenario) -> Spent:
    """Not known without rates, nor where evaluation takes time and nobody counted it."""
    energy = scenario.energy
    uncounted = any(fact.evaluation_motions is None for fact in task_stages(run))
    if not energy.tells_time or (energy.motion_s and uncounted):
        return lambda rounds: math.nan
    held = shared_out(run, scenario)

    def seconds(rounds: float) -> float:
        total_s = times(until(held, rounds), with_beta(energy, held)).total.total_s
        return math.nan if total_s is None else total_s

    return seconds


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


def curves_csv(found: Mapping[str, Curves]) -> Table:
    """A row for each thing that is spent, arm and budget."""
    rows: list[tuple[Cell, ...]] = []
    for what, (budgets, arms) in found.items():
        for arm, each in arms.items():
            for place, budget in enumerate(budgets):
                cells = [None if math.isnan(value) else float(value) for band in each for value in band[:, place]]
                rows.append((what, *arm, float(budget), *cells))
    names = [name for of in ("share", "iqm") for name in (of, f"{of}_low95", f"{of}_high95")]
    return Table("Tasks learned by what was spent", ("spent", *ArmOf._fields, "budget", *names), rows)
