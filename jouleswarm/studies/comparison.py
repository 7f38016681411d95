"""Arms and variants side by side: rounds, success, joules by cause, bits; each a mean over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import CAUSES
from jouleswarm.energy.literal import BITS_PER_BYTE
from jouleswarm.energy.prices import PriceList, own_lists
from jouleswarm.report.table import Cell, Table
from jouleswarm.studies.arms import failures_of, tasks_of
from jouleswarm.studies.carbon import carbon_columns, carbon_estimates, carbon_headings
from jouleswarm.studies.estimates import Estimate, estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import PRICE_LISTS, cost_of, moved_bytes, runs_of, task_stages, total_over_runs
from jouleswarm.studies.tables import estimate_text, failures_text, spread

_CAUSES = CAUSES[:-1]  # literal prices have no other
_CENSORED = (
    "Joules by the equations (literal prices) at the scenario's own efficiencies. A task that was not learned counts "
    "with the rounds that it ran, so rounds, joules and bits of such rows are lower bounds."
)


class Line(NamedTuple):
    """One arm of one variant, over seeds."""

    variant: str
    arm: str
    t0: int
    rounds: Estimate
    """Summed over tasks."""
    success: Estimate
    """Share of the tasks that were learned."""
    causes: tuple[Estimate, ...]
    """Joules by `energy.bill.CAUSES`, literal prices."""
    total: Estimate
    own: tuple[Estimate | None, ...]
    """E by each price list of the user's own; None where it has none."""
    bits: Estimate
    carbon: tuple[Estimate | None, ...]
    """Grams by site and together; empty where no intensity is set."""
    not_learned: int
    trials: int


def lines(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> list[Line]:
    """A line a variant and arm, in the order of the facts."""
    pairs = dict.fromkeys((fact.variant, fact.arm) for fact in facts)
    return [line_of(facts, variant, arm, energy, lists) for variant, arm in pairs]


def line_of(
    facts: Sequence[Fact], variant: str, arm: str, energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS
) -> Line:
    """One arm of one variant."""
    runs = list(runs_of(facts, variant, arm).values())
    spent = [cost_of(run, energy) for run in runs]
    stages = [task_stages(run) for run in runs]
    not_learned, trials = failures_of(facts, variant, arm, tasks_of(facts))
    return Line(
        variant=variant,
        arm=arm,
        t0=runs[0][0].t0,
        rounds=estimate(sum(fact.rounds for fact in tasks) for tasks in stages),
        success=estimate(sum(fact.learned for fact in tasks) / len(tasks) for tasks in stages),
        causes=tuple(estimate(cost.by_cause[cause] for cost in spent) for cause in _CAUSES),
        total=estimate(each.total_j for each in spent),
        own=tuple(total_over_runs(runs, energy, each) for each in own_lists(lists)),
        bits=estimate(BITS_PER_BYTE * moved_bytes(run) for run in runs),
        carbon=carbon_estimates(runs, energy),
        not_learned=not_learned,
        trials=trials,
    )


def comparison_csv(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> Table:
    """All lines for programs; joules and bits, a column of 95% half widths after each mean."""
    rows: list[tuple[Cell, ...]] = []
    for line in lines(facts, energy, lists):
        estimates = (line.rounds, line.success, *line.causes, line.total, line.bits, *line.carbon, *line.own)
        cells = [cell for each in estimates for cell in spread(each)]
        rows.append((line.variant, line.arm, line.t0, *cells, line.rounds.n, line.not_learned, line.trials))
    names = ("rounds", "success", *(cause.column for cause in _CAUSES), "total_j", "bits")
    columns = [column for name in names for column in (name, f"{name}_ci95")]
    columns += carbon_columns(energy)
    columns += [column for each in own_lists(lists) for column in (f"{each.name}_j", f"{each.name}_j_ci95")]
    return Table("Comparison", ("variant", "arm", "t0", *columns, "seeds", "not_learned", "trials"), rows)


def comparison_markdown(
    facts: Sequence[Fact], energy: Energy, title: str, lists: Sequence[PriceList] = PRICE_LISTS
) -> Table:
    """All lines for readers, in kJ and Gbit; the variant's column only where there is more than one."""
    held = lines(facts, energy, lists)
    varied = len({line.variant for line in held}) > 1
    rows: list[tuple[Cell, ...]] = []
    for line in held:
        cells = [estimate_text(each, 1e3) for each in (*line.causes, line.total, *line.own)]
        head = (line.variant, line.arm) if varied else (line.arm,)
        told = (estimate_text(line.rounds), estimate_text(line.success, 0.01))
        counted = failures_text(line.not_learned, line.trials)
        grams = [estimate_text(each) for each in line.carbon]
        rows.append((*head, *told, *cells, estimate_text(line.bits, 1e9), *grams, counted))
    head = ("variant", "arm") if varied else ("arm",)
    totals = ("E (kJ)", *(f"E (kJ), {each.label}" for each in own_lists(lists)))
    units = (*(f"{cause.heading} (kJ)" for cause in _CAUSES), *totals, "Gbit", *carbon_headings(energy))
    return Table(title, (*head, "rounds", "learned (%)", *units, "not learned"), rows, (_CENSORED,))
