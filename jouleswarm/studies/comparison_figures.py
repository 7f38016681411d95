"""Figures of variants side by side, and of methods by what their joules are spent on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.prices import PriceList, own_lists, price_lists
from jouleswarm.report.arms import method_colour, method_label
from jouleswarm.studies.comparison import Line, line_of, lines
from jouleswarm.studies.estimates import Estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.style import INK, blank

_CAUSES = {
    "data center": "#E69F00",
    "robots": "#0072B2",
    "uplink": "#D55E00",
    "downlink": "#009E73",
    "sidelink": "#CC79A7",
}
_ALL_WIDTH = 0.76


def group_figure(facts: Sequence[Fact], scenario: Scenario, what: str, variants: Mapping[str, str]) -> Figure:
    """Rounds, energy and bits against the values of what was varied, arm beside arm; energy by literal prices, and in
    a panel each by the user's own lists.

    Args:
        facts: of all variants.
        scenario: whose constants, price lists and methods.
        what: name of what was varied.
        variants: its value, as shown, -> the variant that has it. Values without facts are left out.
    """
    shown = measured_variants(facts, variants)
    arms = list(dict.fromkeys(fact.arm for fact in facts))
    figure, lists = blank(2.5), price_lists(scenario)
    panels = _panels(own_lists(lists))
    for axes, (label, part) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        for place, arm in enumerate(arms):
            held = [line_of(facts, variant, arm, scenario.energy, lists) for variant in shown.values()]
            failed = [line.not_learned for line in held]
            colour = method_colour(scenario, method_of(arm))
            bars(axes, place, len(arms), [part(line) for line in held], colour, failed)
        axes.set_xticks(range(len(shown)), list(shown))
        axes.set_xlabel(what)
        axes.set_ylabel(label)
    figure.legend(handles=method_patches(scenario, arms), loc="outside upper right", ncols=len(arms))
    return figure


def method_patches(scenario: Scenario, arms: Sequence[str]) -> list[Patch]:
    """Each arm's method in a legend."""
    methods = [method_of(arm) for arm in arms]
    return [
        Patch(facecolor=method_colour(scenario, method), label=method_label(scenario, method)) for method in methods
    ]


def measured_variants(facts: Sequence[Fact], variants: Mapping[str, str]) -> dict[str, str]:
    """Those of a group's values that have facts, value -> variant."""
    measured = {fact.variant for fact in facts}
    return {value: variant for value, variant in variants.items() if variant in measured}


def bars(
    axes: Axes, place: int, among: int, found: Sequence[Estimate], colour: str, not_learned: Sequence[int] = ()
) -> BarContainer:
    """One arm's bars with their intervals, beside those of the other arms; how many tasks were not learned above.

    Args:
        axes: what is drawn on; zero is its bottom, and no interval goes below.
        place: of the arm, from 0.
        among: how many arms there are.
        found: a mean and interval for each value on the x axis.
        colour: of the arm.
        not_learned: tasks that were not learned, for each value; empty for none.
    """
    width = _ALL_WIDTH / among
    at = [x + (place - (among - 1) / 2) * width for x in range(len(found))]
    means = [each.mean for each in found]
    above = [each.ci95 or 0.0 for each in found]
    below = [min(half, mean) for half, mean in zip(above, means, strict=True)]
    drawn = axes.bar(at, means, width, color=colour, yerr=[below, above], ecolor=INK, capsize=2)
    for x, mean, half, failed in zip(at, means, above, not_learned, strict=False):
        if failed:
            axes.annotate(f"{failed}×", (x, mean + half), fontsize=6, ha="center", va="bottom")
    return drawn


def causes_figure(facts: Sequence[Fact], scenario: Scenario) -> Figure:
    """Joules of each method, stacked by cause, and its rounds; a cross where tasks were not learned.

    Between them, a panel a price list of the user's own.
    """
    figure, lists = blank(3.0), price_lists(scenario)
    own = own_lists(lists)
    left, *between, right = figure.subplots(1, 2 + len(own), sharey=True, width_ratios=[3, *(2 for _ in own), 2])
    held = lines(facts, scenario.energy, lists)
    for place, (axes, prices) in enumerate(zip(between, own, strict=True)):
        for row, found in enumerate(line.own[place] for line in held):
            if found is not None:
                half = (found.ci95 or 0.0) / 1e3
                axes.barh(row, found.mean / 1e3, xerr=half, color="#bbbbbb", ecolor=INK, capsize=2)
        axes.set_xlabel(f"$E$ (kJ), {prices.label}")
    for place, line in enumerate(held):
        start = 0.0
        for colour, found in zip(_CAUSES.values(), line.causes, strict=True):
            left.barh(place, found.mean / 1e3, left=start, color=colour)
            start += found.mean / 1e3
        left.errorbar(start, place, xerr=(line.total.ci95 or 0.0) / 1e3, color=INK, capsize=2, elinewidth=0.8)
        right.barh(place, line.rounds.mean, xerr=line.rounds.ci95 or 0.0, color="#bbbbbb", ecolor=INK, capsize=2)
    failed = {place: line for place, line in enumerate(held) if line.not_learned}
    for place, line in failed.items():
        told = f" {line.not_learned} of {line.trials} not learned"
        right.annotate(told, (0, place), fontsize=6, va="center", ha="left")
    left.set_yticks(range(len(held)), [method_label(scenario, method_of(line.arm)) for line in held])
    left.invert_yaxis()
    left.set_xlabel("energy $E$ (kJ), literal prices")
    right.set_xlabel("rounds, all tasks")
    handles = [Patch(facecolor=colour, label=name) for name, colour in _CAUSES.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(_CAUSES))
    return figure


def _panels(own: Sequence[PriceList]) -> dict[str, Callable[[Line], Estimate]]:
    """Axis labels -> what is drawn over them."""

    def by_own(place: int) -> Callable[[Line], Estimate]:
        return lambda line: _scaled(line.own[place] or Estimate(math.nan, None, line.total.n), 1e3)

    return {
        "rounds, all tasks": lambda line: line.rounds,
        "energy $E$ (kJ)": lambda line: _scaled(line.total, 1e3),
        **{f"$E$ (kJ), {each.label}": by_own(place) for place, each in enumerate(own)},
        "moved (Gbit)": lambda line: _scaled(line.bits, 1e9),
    }


def _scaled(found: Estimate, factor: float) -> Estimate:
    return Estimate(found.mean / factor, None if found.ci95 is None else found.ci95 / factor, found.n)
