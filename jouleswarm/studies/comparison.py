"""Arms and variants side by side: rounds, success, joules by cause, bits; each a mean over seeds."""

from __future__ import annotations

from collections.abc import Sequence

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.prices import PriceList, with_beta
from jouleswarm.report.table import Table
from jouleswarm.studies.arms import failures_of
from jouleswarm.studies.columns import arm_columns
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import PRICE_LISTS, facts_of, runs_of
from jouleswarm.studies.tables import estimate_text, failures_text, spread

_CENSORED = (
    "Joules by the equations (literal prices) at the scenario's own efficiencies. A task that was not learned counts "
    "with the rounds that it ran, so rounds, joules and bits of such rows are lower bounds."
)


def arms_of(facts: Sequence[Fact]) -> list[tuple[str, str]]:
    """(variant, arm) of each line, in the order of the facts."""
    return list(dict.fromkeys((fact.variant, fact.arm) for fact in facts))


def comparison_csv(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> Table:
    """A line a variant and arm for programs; joules and bits, a column of 95% half widths after each mean."""
    columns, rows = arm_columns(energy, lists), []
    for variant, arm in arms_of(facts):
        runs = runs_of(facts, variant, arm)
        cells = [cell for column in columns for cell in spread(column.over(facts, variant, arm))]
        t0 = next(iter(runs.values()))[0].t0
        rows.append((variant, arm, t0, *cells, len(runs), *failures_of(facts, variant, arm)))
    names = [name for column in columns for name in column.names]
    return Table("Comparison", ("variant", "arm", "t0", *names, "seeds", "not_learned", "trials"), rows)


def comparison_markdown(
    facts: Sequence[Fact], energy: Energy, title: str, lists: Sequence[PriceList] = PRICE_LISTS
) -> Table:
    """The same for readers, in kJ and Gbit; the variant's column only where there is more than one."""
    columns, rows = arm_columns(energy, lists), []
    varied = len({variant for variant, _ in arms_of(facts)}) > 1
    for variant, arm in arms_of(facts):
        cells = [estimate_text(column.over(facts, variant, arm), column.unit) for column in columns]
        head = (variant, arm) if varied else (arm,)
        rows.append((*head, *cells, failures_text(*failures_of(facts, variant, arm))))
    head = ("variant", "arm") if varied else ("arm",)
    return Table(
        title,
        (*head, *(column.heading for column in columns), "not learned"),
        rows,
        (_CENSORED, *_beta_note(facts, energy)),
    )


def _beta_note(facts: Sequence[Fact], energy: Energy) -> list[str]:
    """Which beta of eq. (9) was priced, where a gradient on B^(b) was."""
    held = {fact.method: with_beta(energy, facts_of([fact])).beta for fact in facts if fact.gradients_query}
    exact = ", ".join(f"{method} {beta:g}" for method, beta in held.items())
    how = "as measured by time" if energy.beta == "measured" else "given"
    return [f"Gradients on B^(b) at beta of eq. (9), {how}: {exact}."] if held else []
