"""Figures of variants side by side, and of methods by what their joules are spent on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.items import BITS_PER_BYTE
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import own_lists, price_lists
from jouleswarm.report.arms import INK, method_colour, method_label
from jouleswarm.report.canvas import SINGLES, new_figure
from jouleswarm.report.look import looks_of
from jouleswarm.studies.arms import failures_of
from jouleswarm.studies.columns import Column, apart_columns, cause_columns, rounds_sum, total_column
from jouleswarm.studies.comparison import arms_of
from jouleswarm.studies.estimates import Estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import moved_bytes
from jouleswarm.studies.record import Record
from jouleswarm.studies.style import estimate_bars

_CAUSES = looks_of(("#E69F00", "#0072B2", "#D55E00", "#009E73", "#CC79A7"))
_ROUNDS = Column("rounds", "rounds, all tasks", 1, rounds_sum)


def group_figure(facts: Sequence[Fact], record: Record, what: str, variants: Mapping[str, str]) -> Figure:
    """Rounds of unseen and of seen tasks, energy and bits against the values of what was varied, arm beside arm;
    energy by literal prices, and in a panel each by the user's own lists; as `panels_figure`.
    """
    scenario, energy = record.scenario, record.scenario.energy
    columns = [
        *rounds_columns(record),
        total_column(literal, energy, "energy $E$ (kJ)"),
        *(total_column(each, energy, f"$E$ (kJ), {each.label}") for each in own_lists(price_lists(scenario))),
        Column("bits", "moved (Gbit)", 1e9, lambda run: BITS_PER_BYTE * moved_bytes(run)),
    ]
    return panels_figure(facts, scenario, {what: (variants, columns)}, 2.5)


def rounds_columns(record: Record) -> list[Column]:
    """Rounds of unseen tasks and, beside them, of seen ones."""
    return [column for column in apart_columns(record.seen) if column.name.startswith("rounds")]


def panels_figure(
    facts: Sequence[Fact],
    scenario: Scenario,
    rows: Mapping[str, tuple[Mapping[str, str], Sequence[Column]]],
    height_in: float,
    *,
    numbered: bool = False,
) -> Figure:
    """A row of panels for each thing that was varied, a panel a column; how many tasks were not learned over each bar.

    Args:
        facts: of all variants.
        scenario: whose methods.
        rows: name of what was varied -> (its value, as shown, -> the variant that has it; what is drawn). Values
            without facts are left out.
        height_in: of a row.
        numbered: the bars' heights in place of the tasks that were not learned.
    """
    figure, known = new_figure(height_in * len(rows)), {fact.variant for fact in facts}
    arms = list(dict.fromkeys(fact.arm for fact in facts))
    looks = dict(zip(arms, looks_of([method_colour(scenario, method_of(arm)) for arm in arms]), strict=True))
    panels = figure.subplots(len(rows), max(len(columns) for _, columns in rows.values()), squeeze=False)
    for row, (what, (variants, columns)) in zip(panels, rows.items(), strict=True):
        shown = {value: variant for value, variant in variants.items() if variant in known}
        for axes, column in zip(row, columns, strict=True):
            for place, arm in enumerate(arms):
                found = [column.shown(facts, variant, arm) for variant in shown.values()]
                failed = [failures_of(facts, variant, arm)[0] for variant in shown.values()]
                texts = [f"{each.mean:.3g}" for each in found] if numbered else [f"{n}×" if n else "" for n in failed]
                estimate_bars(axes, place, len(arms), found, looks[arm], texts, turned=numbered)
            axes.set_xticks(range(len(shown)), list(shown))
            axes.set_xlim(-0.5, len(shown) - 0.5)
            axes.set_xlabel(what)
            axes.set_ylabel(column.heading)
    labels = {arm: method_label(scenario, method_of(arm)) for arm in arms}
    handles = [Patch(**looks[arm].face, label=labels[arm]) for arm in arms]
    figure.legend(handles=handles, loc="outside upper right", ncols=len(arms))
    return figure


def causes_figure(facts: Sequence[Fact], scenario: Scenario) -> Figure:
    """Joules of each method, stacked by cause, and its rounds; a note where tasks were not learned.

    Between them, a panel a price list of the user's own.
    """
    figure, energy, own = new_figure(3.0), scenario.energy, own_lists(price_lists(scenario))
    first, *others = figure.subplots(1, 2 + len(own), sharey=True, width_ratios=[3, *(2 for _ in own), 2])
    held, causes = arms_of(facts), cause_columns(energy)
    total = total_column(literal, energy, "energy $E$ (kJ), literal prices")
    columns = [*(total_column(each, energy, f"$E$ (kJ), {each.label}") for each in own), _ROUNDS]
    for place, arm in enumerate(held):
        start = 0.0
        for look, cause in zip(_CAUSES, causes, strict=True):
            spent = cause.shown(facts, *arm).mean
            first.barh(place, spent, left=start, **look.face)
            start += spent
        _spread(first, place, total.shown(facts, *arm))
        for axes, column in zip(others, columns, strict=True):
            found = column.shown(facts, *arm)
            axes.barh(place, found.mean, color="#bbbbbb")
            _spread(axes, place, found)
        not_learned, trials = failures_of(facts, *arm)
        if not_learned:
            told = f" {not_learned} of {trials} not learned"
            others[-1].annotate(told, (0, place), fontsize=6, va="center", ha="left")
    names = [", ".join(filter(None, (method_label(scenario, method_of(arm)), variant))) for variant, arm in held]
    first.set_yticks(range(len(held)), names)
    first.invert_yaxis()
    for axes, column in zip((first, *others), (total, *columns), strict=True):
        axes.set_xlabel(column.heading)
    names = [cause.heading.removesuffix(" (kJ)") for cause in causes]
    handles = [Patch(**look.face, label=name) for look, name in zip(_CAUSES, names, strict=True)]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(_CAUSES))
    return figure


def _spread(axes: Axes, place: int, found: Estimate) -> None:
    """The interval across the end of a bar that lies, or of three seeds or fewer each one's value."""
    if found.drawn_ci95:
        axes.errorbar(found.mean, place, xerr=found.drawn_ci95, color=INK, capsize=2, elinewidth=0.8)
    axes.plot(found.singles, [place] * len(found.singles), **SINGLES)
