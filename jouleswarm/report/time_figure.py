"""Joules against seconds, drawn."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price, with_beta
from jouleswarm.energy.times import Times, times
from jouleswarm.report.arms import INK, labels, looks
from jouleswarm.report.canvas import LEGEND_COLUMNS, legend_in, new_figure
from jouleswarm.runs.run import Run
from jouleswarm.runs.seconds import front


def time_figure(run: Run, energy: Energy) -> Figure:
    """E, eq. (12), against seconds, an arm a point; the line goes through those that none beats in both."""
    figure = new_figure(2.8 + legend_in(len(run.scenario.arms)))
    axes = figure.subplots()
    held, points = _times(run, energy), {}
    known = all(found.total.communication_s is not None for found in held.values())
    for arm, found in held.items():
        bill = price(literal, run.facts[arm], energy)
        if bill is not None and run.facts[arm].metered:
            points[arm] = (found.total.computing_s + (found.total.communication_s or 0.0), bill.total_j / 1e3)
    best = [points[arm] for arm in front(points)]
    axes.step([x for x, _ in best], [y for _, y in best], where="post", color=INK, linewidth=0.7, linestyle="--")
    for arm, (seconds, kilojoules) in points.items():
        edge = INK if (seconds, kilojoules) in best else "none"
        look = looks(run.scenario)[arm]
        axes.scatter(seconds, kilojoules, color=look.colour, marker=look.marker, edgecolors=edge, zorder=3)
    axes.set_xlabel("seconds to learn" if known else "seconds of computing (communication is not known)")
    axes.set_ylabel("energy (kJ)")
    axes.margins(0.1)
    figure.legend(handles=_points(run), loc="outside upper center", ncols=LEGEND_COLUMNS)
    return figure


def _points(run: Run) -> list[Line2D]:
    held = looks(run.scenario)
    return [
        Line2D([], [], linestyle="", color=held[arm].colour, marker=held[arm].marker, label=name)
        for arm, name in labels(run.scenario).items()
    ]


def _times(run: Run, energy: Energy) -> dict[str, Times]:
    return {arm: times(facts, with_beta(energy, facts)) for arm, facts in run.facts.items()}
