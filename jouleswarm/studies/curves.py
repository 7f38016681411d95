"""What share of tasks each arm had learned by what it had spent, and R, over seeds and tasks.

Share and interquartile mean of the scores 0 and 1 of all seeds and tasks, and interquartile mean of their R, with
intervals by stratified bootstrap: of each task its seeds are drawn again (Agarwal et al. 2021, Deep RL at the edge of
the statistical precipice). The share is their performance profile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import trim_mean

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.curves import until
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
    reward: Band
    """NaN where R is not known, and before every seed has paid for the stage."""


class Curves(NamedTuple):
    """Of all arms against one thing that is spent."""

    budgets: NDArray[np.float64]
    """[n] the same for all arms, from the least to the most that a task took."""
    arms: dict[ArmOf, Profile]
    """Those of which it is known what they had spent."""
    seeds: dict[ArmOf, int]


def curves_of(facts: Sequence[Fact], scenario: Scenario) -> dict[str, Curves]:
    """By what is spent, of `SPENT`; without what is not known of any arm, or where nothing was learned.

    Args:
        facts: with motions.
        scenario: at whose prices, and by whose rates; seconds are known where it has any (`Energy.tells_time`).
    """
    arms = [arm for held in arms_by_variant(facts).values() for arm in held]
    runs = {arm: list(runs_of(facts, arm.variant, arm.arm).values()) for arm in arms}
    costs = {arm: to_learn(runs[arm], scenario) for arm in arms}
    found = {}
    for what in SPENT:
        held = {arm: each[what] for arm, each in costs.items() if not np.isnan(each[what]).any()}
        told = np.concatenate([each.ravel() for each in held.values()] or [np.empty(0)])
        told = told[np.isfinite(told) & (told > 0)]
        if len(told):
            budgets = np.geomspace(told.min(), told.max(), _BUDGETS)
            profiles = {
                arm: Profile(*learned_by(each, budgets), mean_reward(rewards_at(runs[arm], scenario, what, budgets)))
                for arm, each in held.items()
            }
            found[what] = Curves(budgets, profiles, {arm: len(each) for arm, each in held.items()})
    return found


def to_learn(runs: Collection[Sequence[Fact]], scenario: Scenario) -> dict[str, NDArray[np.float64]]:
    """For each of `SPENT` [seeds, tasks] what an arm had spent, on all tasks, when a task was learned.

    Infinite where it was not learned, NaN where what was spent is not known. Clusters learn side by side, as in
    `energy.curves`.
    """
    found: dict[str, list[list[float]]] = {what: [] for what in SPENT}
    for run in runs:
        tasks = sorted(task_stages(run), key=lambda fact: fact.task)
        for what, spent in _spending(run, scenario).items():
            found[what].append([spent(fact.rounds) if fact.learned else math.inf for fact in tasks])
    return {what: np.array(rows) for what, rows in found.items()}


def rewards_at(
    runs: Sequence[Sequence[Fact]], scenario: Scenario, what: str, budgets: NDArray[np.float64]
) -> NDArray[np.float64]:
    """[seeds, tasks, budgets] R of each task by then, its last one where it had stopped; NaN before the stage is paid
    for, and where the facts do not tell R."""
    tables = []
    for run in runs:
        told = [np.array(fact.rewards.split(), float) for fact in sorted(task_stages(run), key=lambda fact: fact.task)]
        spent, rounds = _spending(run, scenario)[what], max(map(len, told), default=0)
        after = np.searchsorted([spent(round_) for round_ in range(rounds)], budgets, side="right") - 1
        rows = [each[np.clip(after, 0, len(each) - 1)] if len(each) else np.full(len(budgets), np.nan) for each in told]
        tables.append(np.where(after < 0, np.nan, rows))
    return np.array(tables)


def _spending(run: Sequence[Fact], scenario: Scenario) -> dict[str, Spent]:
    """By what is spent, of `SPENT`."""
    sums, energy = facts_of(run), scenario.energy

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
        "seconds": _seconds(run, scenario),
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


def learned_by(costs: NDArray[np.float64], budgets: NDArray[np.float64]) -> tuple[Band, Band]:
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
    return _band(counts / (seeds * tasks)), _band(_interquartile(counts, seeds * tasks))


def mean_reward(rewards: NDArray[np.float64]) -> Band:
    """The interquartile mean of R, [seeds, tasks, budgets]; NaN where one is."""
    seeds, tasks, budgets = rewards.shape
    found = np.full((3, budgets), np.nan)
    known = ~np.isnan(rewards).any(axis=(0, 1))
    if known.any():
        held = rewards[:, :, known]
        drawn = np.random.default_rng(1).integers(seeds, size=(_DRAWS, seeds, tasks))
        again = held[drawn, np.arange(tasks)].reshape(_DRAWS, seeds * tasks, -1)
        means = np.vstack([trim_mean(held.reshape(seeds * tasks, -1), 0.25), trim_mean(again, 0.25, axis=1)])
        if seeds < 2:
            means[1:] = math.nan
        found[:, known] = _band(means)
    return found


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
    for what, curves in found.items():
        for arm, each in curves.arms.items():
            for place, budget in enumerate(curves.budgets):
                cells = [None if math.isnan(value) else float(value) for band in each for value in band[:, place]]
                rows.append((what, *arm, float(budget), *cells))
    names = [name for of in Profile._fields for name in (of, f"{of}_low95", f"{of}_high95")]
    return Table("Tasks learned by what was spent", ("spent", *ArmOf._fields, "budget", *names), rows)
