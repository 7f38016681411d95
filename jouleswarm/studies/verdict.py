"""Does learning a model first cut the bill by half? The answer as data, and from which price or number of tasks on."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from statistics import fmean
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.breakeven import Kind, stage_alone, tasks_for
from jouleswarm.energy.crossing import Curve, Verdict, cheaper
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.report.table import Cell, Table, number
from jouleswarm.studies.arms import PLAIN, groups_of, lines_of
from jouleswarm.studies.beta import BETA_1
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import facts_of, of_tasks, runs_of
from jouleswarm.studies.ratio_tables import CHEAPEST_NOTE
from jouleswarm.studies.significance import Between, ratios
from jouleswarm.studies.tables import between_text

FACTORS = (2.0, 1.0)
"""Half the bill, and no more than the bill without."""
_LINEAR = (literal.name, BETA_1.name)
"""Lists that are linear in 1/E_UL."""


class Bills(NamedTuple):
    """Joules of an arm and of the one without transfer on a group of tasks, seed by seed."""

    stage: list[float]
    mine: list[float]
    """With the stage."""
    plain: list[float]


class Answer(NamedTuple):
    """Of an arm, a group of tasks and a price list."""

    tasks: str
    method: str
    t0: int
    prices: str
    ratio: Between
    """The bill without over that with."""
    ul: tuple[Verdict | None, ...]
    """For each of `FACTORS`, at which E_UL the ratio is that or more, E_SL as it is; None where a list does not say."""
    from_tasks: tuple[float, ...]
    """For each, from how many tasks of the group on; of all, the seen ones first, and none of them twice."""

    @property
    def halves(self) -> str:
        """Whether the bill is cut by half or more: `yes`, `no`, or `open` where the interval says both."""
        low, high = (self.ratio.value if each is None else each for each in self.ratio[1:])
        return "yes" if low >= FACTORS[0] else "no" if high < FACTORS[0] else "open"


def answers(
    facts: Sequence[Fact], training: Collection[int], energy: Energy, lists: Sequence[PriceList]
) -> list[Answer]:
    """A row a group of tasks (unseen first), price list and arm; without those that a list has no bill for."""
    groups, found = groups_of(facts, training), []
    for name, tasks in groups.items():
        for prices in lists:
            for method, t0, arm in (line for line in lines_of(facts) if line.t0):
                bills = bills_of(facts, arm, tasks, energy, prices)
                if bills is None:
                    continue
                apart = [groups[each] for each in (("seen", "unseen") if name == "all" else (name,)) if each in groups]
                kinds = _kinds(facts, arm, apart, energy, prices)
                stage_j = fmean(bills.stage)
                ul = _curves(facts, arm, tasks, energy, prices)
                found.append(
                    Answer(
                        name,
                        method,
                        t0,
                        prices.name,
                        ratios(bills.plain, bills.mine).of_means,
                        tuple(ul and _from_ul(factor, *ul) for factor in FACTORS),
                        tuple(tasks_for(factor, stage_j, kinds) for factor in FACTORS),
                    )
                )
    return found


def bills_of(
    facts: Sequence[Fact], arm: str, tasks: Collection[int], energy: Energy, prices: PriceList
) -> Bills | None:
    """Over the seeds that both arms have; None where there are none, or one has no bill."""
    ours, theirs = (runs_of(facts, "", each) for each in (arm, PLAIN))
    rows: list[list[float]] = []
    for seed in (seed for seed in ours if seed in theirs):
        parts = [stage_alone(facts_of(ours[seed]).of_ml())]
        parts += [facts_of(of_tasks(runs[seed], tasks)) for runs in (ours, theirs)]
        bills = [price(prices, part, energy) for part in parts]
        if any(bill is None for bill in bills):
            return None
        rows.append([bill.total_j for bill in bills if bill is not None])
    return Bills(*map(list, zip(*rows, strict=True))) if rows else None


def _kinds(
    facts: Sequence[Fact], arm: str, groups: Sequence[Collection[int]], energy: Energy, prices: PriceList
) -> list[Kind]:
    """One of each group, of the last one as many as are asked for."""
    kinds = []
    for place, tasks in enumerate(groups, start=1):
        if (bills := bills_of(facts, arm, tasks, energy, prices)) is not None:
            stage_j, mine_j, plain_j = map(fmean, bills)
            among = math.inf if place == len(groups) else len(tasks)
            kinds.append(Kind(among, plain_j / len(tasks), (mine_j - stage_j) / len(tasks)))
    return kinds


def _curves(
    facts: Sequence[Fact], arm: str, tasks: Collection[int], energy: Energy, prices: PriceList
) -> tuple[Curve, Curve] | None:
    """Mean bills with and without against E_UL: two prices tell a line in 1/E_UL."""
    if prices.name not in _LINEAR:
        return None
    here = energy.ul_bit_per_j
    found = [
        bills_of(facts, arm, tasks, energy.model_copy(update={"ul_bit_per_j": each}), prices)
        for each in (here, 2 * here)
    ]
    one, other = ([fmean(bills.mine), fmean(bills.plain)] for bills in found if bills is not None)
    mine, plain = (
        Curve(2 * double - single, 2 * here * (single - double)) for single, double in zip(one, other, strict=True)
    )
    return mine, plain


def _from_ul(factor: float, mine: Curve, plain: Curve) -> Verdict:
    return cheaper(Curve(factor * mine.fixed, factor * mine.bits), plain)


def verdict_csv(found: Sequence[Answer], energy: Energy) -> Table:
    """For programs; `always` and `never` are over all E_UL, inf: with no number of tasks."""
    rows: list[tuple[Cell, ...]] = []
    for each in found:
        ul: list[Cell] = []
        for verdict in each.ul:
            at = verdict.bit_per_j if verdict else None
            ul += [verdict.where if verdict else None, None if at is None else at / 1e3]
        head = (each.tasks, each.method, each.t0, each.prices, energy.ul_bit_per_j / 1e3, energy.sl_bit_per_j / 1e3)
        rows.append((*head, *each.ratio, each.halves, *ul, *each.from_tasks))
    headings = ("tasks", "method", "t0", "prices", "ul_kb_per_j", "sl_kb_per_j", "ratio", "low95", "high95", "halves")
    where = [f"{name}_{factor:g}" for factor in FACTORS for name in ("ul_where", "ul_kb_per_j_where")]
    return Table("Verdict", (*headings, *where, *(f"tasks_{factor:g}" for factor in FACTORS)), rows)


def verdict_markdown(found: Sequence[Answer], energy: Energy) -> Table:
    """For readers: of each group, list and method the t0 that gains most."""
    best: dict[tuple[str, str, str], Answer] = {}
    for each in found:
        key = each.tasks, each.prices, each.method
        best[key] = max(best.get(key, each), each, key=lambda answer: answer.ratio.value)
    rows: list[tuple[Cell, ...]] = [
        (each.tasks, each.prices, each.method, each.t0, between_text(each.ratio), each.halves,
         *map(_ul_text, each.ul), *map(_tasks_text, each.from_tasks))
        for each in best.values()
    ]  # fmt: skip
    headings = ("tasks", "prices", "method", "best t0", "bill without / with", "cut by 2x?", "E_UL for 2x (kb/J)")
    more = ("E_UL for 1x", "tasks for 2x", "tasks for 1x")
    told = (
        f"At E_UL = {energy.ul_bit_per_j / 1e3:g} and E_SL = {energy.sl_bit_per_j / 1e3:g} kb/J, the study's tasks; "
        "the middle 95% over seeds drawn again. E_UL moves with E_SL as it is; tasks are of the group (of all: the "
        "seen ones first, then unseen ones)."
    )
    return Table("Does it cut the bill by 2x?", (*headings, *more), rows, (told, CHEAPEST_NOTE))


def _ul_text(verdict: Verdict | None) -> str:
    if verdict is None:
        return "-"
    return verdict.where if verdict.bit_per_j is None else f"{verdict.where} {number(verdict.bit_per_j / 1e3)}"


def _tasks_text(tasks: float) -> str:
    return "never" if math.isinf(tasks) else f"{math.ceil(tasks):,}"
