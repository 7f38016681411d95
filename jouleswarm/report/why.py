"""Why the verdict is what it is: what each bill hangs on, when it turns, and how sure it is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.breakeven import returns_to_pay, tasks_to_pay
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, price, with_beta
from jouleswarm.energy.uncertain import bills, draw, interval, pays
from jouleswarm.energy.why import CONSTANTS, Hang, Price, hangs, total_of
from jouleswarm.methods.consensus import BASELINE
from jouleswarm.report.arms import label, labels, method_label
from jouleswarm.report.format import joules_text
from jouleswarm.report.table import Table
from jouleswarm.runs.breakeven import comparable, savings_of
from jouleswarm.runs.run import Run


def why_tables(run: Run, energy: Energy, prices: PriceList = literal) -> list[Table]:
    """For each arm with a stage before: what its bill hangs on, and at which value the verdict would turn."""
    tables, plain = [], method_label(run.scenario, BASELINE)
    for arm in comparable(run):
        facts = run.facts[arm.name]
        mine, other = total_of(facts, prices), total_of(run.facts[BASELINE], prices)
        told = f"{label(run.scenario, arm)} against {plain}"
        tables.append(why_table(told, sorted_hangs(with_beta(energy, facts), mine, other)))
    return tables


def sorted_hangs(energy: Energy, mine: Price, other: Price) -> list[Hang]:
    """`hangs`, what the bill hangs on most first."""
    return sorted(hangs(energy, mine, other), key=lambda each: -abs(each.elasticity))


def why_table(against: str, found: Iterable[Hang]) -> Table:
    """What one bill hangs on, for readers."""
    rows = [
        [
            CONSTANTS[each.constant],
            f"{each.value:.4g}",
            f"{abs(each.elasticity):.2%}",
            f"{each.elasticity:+.4f}",
            "never" if each.turns_at is None else f"{each.turns_at:.4g}",
        ]
        for each in found
    ]
    headings = ["constant", "value", "share of the bill", "elasticity", "verdict turns at"]
    return Table(f"What the bill hangs on: {against}", headings, rows)


def breakeven_tables(run: Run, energy: Energy, prices: PriceList = literal) -> list[Table]:
    """From how many tasks, or returns of a seen one, learning a model first pays; none without such an arm."""
    rows = []
    for arm in comparable(run):
        found = savings_of(run, arm.name, with_beta(energy, run.facts[arm.name]), prices)
        if found is not None:
            saved = (_signed(found.seen_j), _signed(found.unseen_j))
            until = (_count(tasks_to_pay(found)), _count(returns_to_pay(found)))
            rows.append([label(run.scenario, arm), joules_text(found.stage_j), *saved, str(found.seen_tasks), *until])
    headings = ["arm", "stage", "saved a seen task", "an unseen one", "seen", "pays from tasks", "or returns"]
    return [Table(f"When it pays against {method_label(run.scenario, BASELINE)}", headings, rows)] if rows else []


def uncertain_tables(run: Run, energy: Energy, prices: PriceList = literal) -> list[Table]:
    """The bills at constants that are ranges, and how likely each arm is the cheaper one; none where all are exact."""
    metered = {arm: facts for arm, facts in run.facts.items() if facts.metered}
    return ranges_tables(metered, labels(run.scenario), energy, prices, BASELINE)


def ranges_tables(
    facts: Mapping[str, Facts], names: Mapping[str, str], energy: Energy, prices: PriceList, plain: str
) -> list[Table]:
    """The same of any arms, by their names; `plain`: the one that the others are held against."""
    arms = [arm for arm, each in facts.items() if price(prices, each, energy) is not None] if energy.uncertain else []
    if not arms:
        return []
    beta = {arm: with_beta(energy, facts[arm]).beta for arm in arms}
    totals = {arm: total_of(facts[arm], prices, beta[arm]) for arm in arms}
    joules, rows = bills(totals, list(draw(energy))), []
    for arm in arms:
        found = interval(joules[arm])
        cheaper = f"{pays(joules[arm], joules[plain]):.1%}" if arm != plain and plain in joules else ""
        told = (joules_text(found.mean), f"{joules_text(found.low)} to {joules_text(found.high)}", cheaper)
        rows.append([names[arm], joules_text(totals[arm](energy)), *told])
    ranges = ", ".join(f"{name} {each.low:g} to {each.high:g}" for name, each in energy.uncertain.items())
    headings = ["arm", "at the nominal values", "mean", "middle 95%", f"cheaper than {names.get(plain, plain)}"]
    return [Table(f"E where constants are ranges: {ranges}", headings, rows)]


def _signed(joules: float) -> str:
    return f"-{joules_text(-joules)}" if joules < 0 else joules_text(joules)


def _count(number: float) -> str:
    return "never" if math.isinf(number) else f"{math.ceil(number):,}"
