"""Arms and variants side by side: rounds, success, joules by cause, bits; each a mean over seeds."""

from __future__ import annotations

from collections.abc import Sequence

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, with_beta
from jouleswarm.report.table import Table, number
from jouleswarm.studies.arms import PLAIN, failures_of
from jouleswarm.studies.columns import Seen, arm_columns, total_column
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import PRICE_LISTS, facts_of, runs_of
from jouleswarm.studies.tables import at_least, estimate_text, failures_text, spread

_CENSORED = (
    "Joules by the equations (literal prices) at the scenario's own efficiencies. A task that was not learned counts "
    "with the rounds that it ran, so rounds, joules and bits of such rows are lower bounds (≥). Copied: R at the "
    "target in round 0 or 1."
)
BASE = "base"
"""The variant of every point that leaves the scenario as it is."""


def arms_of(facts: Sequence[Fact]) -> list[tuple[str, str]]:
    """(variant, arm) of each line, in the order of the facts."""
    return list(dict.fromkeys((fact.variant, fact.arm) for fact in facts))


def comparison_csv(
    facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS, seen: Seen | None = None
) -> Table:
    """A line a variant and arm for programs; joules and bits, a column of 95% half widths after each mean."""
    columns, rows = arm_columns(energy, lists, seen), []
    for variant, arm in arms_of(facts):
        runs = runs_of(facts, variant, arm)
        cells = [cell for column in columns for cell in spread(column.over(facts, variant, arm))]
        t0 = next(iter(runs.values()))[0].t0
        rows.append((variant, arm, t0, *cells, len(runs), *failures_of(facts, variant, arm)))
    names = [name for column in columns for name in column.names]
    return Table("Comparison", ("variant", "arm", "t0", *names, "seeds", "not_learned", "trials"), rows)


def comparison_markdown(
    facts: Sequence[Fact],
    energy: Energy,
    title: str,
    lists: Sequence[PriceList] = PRICE_LISTS,
    seen: Seen | None = None,
) -> Table:
    """The same for readers, in kJ and Gbit; the variant's column only where there is more than one."""
    columns, rows = arm_columns(energy, lists, seen), []
    varied = len({variant for variant, _ in arms_of(facts)}) > 1
    for variant, arm in arms_of(facts):
        failed = failures_of(facts, variant, arm)
        cells = [
            at_least(estimate_text(column.over(facts, variant, arm), column.unit), failed[0] if column.counts else 0)
            for column in columns
        ]
        head = (variant or BASE, arm) if varied else (arm,)
        rows.append((*head, *cells, failures_text(*failed)))
    head = ("variant", "arm") if varied else ("arm",)
    return Table(
        title,
        (*head, *(column.heading for column in columns), "not learned"),
        rows,
        (_CENSORED, *_beta_note(facts, energy)),
    )


def cheapest_note(facts: Sequence[Fact], energy: Energy) -> list[str]:
    """Which arm without a stage before is the cheapest, and what `fl`, the paper's baseline, costs beside it."""
    column, found = total_column(literal, energy, ""), {}
    for variant, arm in arms_of([fact for fact in facts if not fact.t0]):
        if (joules := column.over(facts, variant, arm)) is not None:
            found[variant, arm] = joules.mean
    if not found or ("", PLAIN) not in found:
        return []
    (variant, arm), least_j = min(found.items(), key=lambda item: item[1])
    name, plain_j = f"{arm} with {variant}" if variant else arm, found["", PLAIN]
    told = f"Baselines at their cheapest: {name}, {number(least_j / 1e3)} kJ by the equations"
    return [f"{told}; fl, which transfer is compared with, {number(plain_j / 1e3)} kJ."]


def _beta_note(facts: Sequence[Fact], energy: Energy) -> list[str]:
    """Which beta of eq. (9) was priced, where a gradient on B^(b) was."""
    held = {fact.method: with_beta(energy, facts_of([fact])).beta for fact in facts if fact.gradients_query}
    exact = ", ".join(f"{method} {beta:g}" for method, beta in held.items())
    how = "as measured by time" if energy.beta == "measured" else "given"
    return [f"Gradients on B^(b) at beta of eq. (9), {how}: {exact}."] if held else []
