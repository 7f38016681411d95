"""What transfer gains, method by method and t0 by t0: ratios of rounds and of bills, unseen tasks apart from seen."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from statistics import fmean
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.prices import PriceList
from jouleswarm.studies.arms import (
    PLAIN,
    Line,
    by_full_window,
    copied_share,
    groups_of,
    lines_of,
    path_error,
    zero_shot_share,
)
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import failures, of_tasks, priced, runs_of, task_stages
from jouleswarm.studies.significance import Ratios, holm, paired_p, ratios

FULL, FIRST, JOULES = "full_window", "first_success", "joules_"
"""Measures: t_i by the full window of R, the paper's; by the first success; and the bill by a price list."""
Values = dict[int, float]
"""Seed -> what is measured."""


class Told(NamedTuple):
    """What beside a measure is known of an arm's trials on a group of tasks, all seeds together."""

    at_round_0: float | None
    copied: float | None
    """Share with R at the target in round 0 or 1: nothing was learned there, the model was taken as it came."""
    not_learned: int
    """Cut off at max_rounds: their rounds and joules are lower bounds."""
    trials: int
    rmse_mean_m: float | None
    """Of path errors at the stop."""
    rmse_worst_m: float | None


class Row(NamedTuple):
    """An arm beside the one without transfer, by one measure on one group of tasks, over the seeds that both have."""

    method: str
    t0: int
    tasks: str
    measure: str
    seeds: int
    without: float
    """Mean over seeds of the group's sum."""
    with_: float
    gain: Ratios
    """Without over with: above 1 transfer saves."""
    p: float | None
    p_holm: float | None
    """By Holm over all methods and t0 of the same group and measure."""
    mine: Told
    plain: Told


def ratio_rows(
    facts: Sequence[Fact], training: Collection[int], window: int, energy: Energy, lists: Sequence[PriceList]
) -> list[Row]:
    """By group of tasks (unseen first) and measure, every arm with a stage; none where none ran without transfer.

    Args:
        facts: of one variant.
        training: tasks of meta-training.
        window: rounds of R's full window.
        energy: constants and efficiencies.
        lists: of each the bills; those without one are left out.
    """
    rows: list[Row] = []
    full, stages = by_full_window(facts, window), [line for line in lines_of(facts) if line.t0]
    for name, tasks in groups_of(facts, training).items():
        sources = [(FULL, full, None), (FIRST, facts, None), *((JOULES + each.name, facts, each) for each in lists)]
        for measure, source, prices in sources:
            family = [_row(facts, source, name, tasks, measure, energy, prices, line) for line in stages]
            held = [row for row in family if row is not None]
            adjusted = holm([row.p for row in held])
            rows += [row._replace(p_holm=p) for row, p in zip(held, adjusted, strict=True)]
    return rows


def _row(
    facts: Sequence[Fact],
    source: Sequence[Fact],
    name: str,
    tasks: Collection[int],
    measure: str,
    energy: Energy,
    prices: PriceList | None,
    line: Line,
) -> Row | None:
    method, t0, arm = line
    mine, plain = (_measured(source, each, tasks, measure, energy, prices) for each in (arm, PLAIN))
    seeds = [seed for seed in mine if seed in plain]
    if not seeds:
        return None
    ours, theirs = [mine[seed] for seed in seeds], [plain[seed] for seed in seeds]
    told = [_told(facts, each, tasks, seeds) for each in (arm, PLAIN)]
    p = paired_p(theirs, ours)
    return Row(
        method, t0, name, measure, len(seeds), fmean(theirs), fmean(ours), ratios(theirs, ours), p, None, *told
    )  # fmt: skip


def _measured(
    facts: Sequence[Fact],
    arm: str,
    tasks: Collection[int],
    measure: str,
    energy: Energy,
    prices: PriceList | None,
) -> Values:
    """Of each seed of which it is known."""
    found: Values = {}
    for seed, run in runs_of(facts, "", arm).items():
        held = of_tasks(run, tasks)
        if prices is None:
            found[seed] = sum(fact.rounds if measure == FULL else fact.rounds_first for fact in task_stages(held))
        elif (bill := priced(held, energy, prices)) is not None:
            found[seed] = bill.total_j
    return found


def _told(facts: Sequence[Fact], arm: str, tasks: Collection[int], seeds: Collection[int]) -> Told:
    held = [fact for fact in task_stages(facts) if fact.arm == arm and fact.task in tasks and fact.seed in seeds]
    errors_m = path_error(held, "", arm) or (None, None)
    return Told(zero_shot_share(held), copied_share(held), failures(held), len(held), *errors_m)
