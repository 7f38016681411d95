"""How an answer moves where one constant is halved or doubled, drawn."""

from __future__ import annotations

import math
from collections.abc import Iterator

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import with_beta
from jouleswarm.energy.why import CONSTANTS, Price, scaled, total_of, value_of
from jouleswarm.methods.consensus import BASELINE
from jouleswarm.report.arms import INK, colours, label, method_label
from jouleswarm.report.canvas import new_figure
from jouleswarm.runs.breakeven import comparable
from jouleswarm.runs.run import Run

_MOST_PANELS = 3


def tornado_figure(run: Run, energy: Energy) -> Figure:
    """How the factor between the arms with a stage and the one without moves where a constant is halved or doubled.

    Args:
        run: with arms that may be compared.
        energy: the constants.
    """
    arms = comparable(run)[:_MOST_PANELS]
    figure = new_figure(0.6 + 1.9 * len(arms))
    for axes, arm in zip(figure.subplots(len(arms), 1, squeeze=False).ravel(), arms, strict=True):
        here, facts = with_beta(energy, run.facts[arm.name]), (run.facts[arm.name], run.facts[BASELINE])
        mine, other = (total_of(each, literal) for each in facts)
        tornado(axes, here, _ratio(mine, other), colours(run.scenario)[arm.name])
        axes.axvline(1.0, color=INK, linewidth=0.8, linestyle="--")
        axes.set_xlabel(f"joules of {label(run.scenario, arm)} / joules of {method_label(run.scenario, BASELINE)}")
    return figure


def tornado(axes: Axes, energy: Energy, answer: Price, colour: str) -> None:
    """How an answer moves where one constant is halved (the arrow's end) or doubled; infinite ones are left out."""
    axes.use_sticky_edges = False  # room for the names
    bars = sorted(_bars(energy, answer), key=lambda bar: abs(math.log(bar[2] / bar[1])))
    for place, (constant, half, double) in enumerate(bars):
        axes.barh(place, double - half, left=half, color=colour, height=0.6)
        axes.plot(half, place, marker="<" if half < double else ">", color=INK, markersize=3)
        axes.annotate(f" {CONSTANTS[constant]}", (max(half, double), place), va="center", fontsize=7)
    if math.isfinite(now := answer(energy)):
        axes.axvline(now, color=INK, linewidth=0.8)
        axes.set_xscale("log")
    axes.set_yticks([])


def _bars(energy: Energy, answer: Price) -> Iterator[tuple[str, float, float]]:
    """(constant, the answer where it is halved, where it is doubled) of the constants that move it."""
    for constant in CONSTANTS:
        if not value_of(energy, constant):
            continue
        half, double = (answer(scaled(energy, constant, factor)) for factor in (0.5, 2.0))
        if math.isfinite(half + double) and abs(math.log(double / half)) > 1e-6:
            yield constant, half, double


def _ratio(mine: Price, other: Price) -> Price:
    return lambda energy: mine(energy) / other(energy)
