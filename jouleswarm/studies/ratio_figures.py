"""Figures of methods side by side against t0: rounds, and what transfer gains; unseen tasks apart from seen."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.literal import literal
from jouleswarm.report.arms import INK, method_colour, method_label
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.look import Look, looks_of
from jouleswarm.studies.arms import PLAIN, by_full_window, failures_of, groups_of, lines_of, rounds_estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.ratios import FULL, JOULES, Row
from jouleswarm.studies.style import OPEN, points

_APART = 2.0
"""Rounds of t0 between methods, so that no interval hides another."""


def methods_figure(facts: Sequence[Fact], scenario: Scenario, training: Collection[int]) -> Figure:
    """Rounds summed over unseen and over seen tasks against t0, t_i by the full window, a method a colour.

    Learning without transfer is the line across; an open marker is a lower bound.
    """
    full, lines = by_full_window(facts, scenario.federation.reward_window), lines_of(facts)
    groups = {name: of for name, of in groups_of(facts, training).items() if name != "all"}
    methods = list(dict.fromkeys(line.method for line in lines))
    looks = _looks(methods, scenario)
    figure = new_figure(2.8)
    for axes, (name, of) in zip(figure.subplots(1, len(groups), squeeze=False)[0], groups.items(), strict=True):
        for place, method in enumerate(methods):
            arms = [line for line in lines if line.method == method]
            found = [rounds_estimate(full, line.arm, of) for line in arms]
            one, told = looks[method], method_label(scenario, method)
            if method == PLAIN:
                axes.axhline(found[0].mean, color=one.colour, linestyle=one.line, linewidth=1.2, label=told)
                half = found[0].ci95 or 0.0
                axes.axhspan(found[0].mean - half, found[0].mean + half, color=one.colour, alpha=0.15, linewidth=0)
                continue
            at = [line.t0 + _APART * (place - len(methods) / 2) for line in arms]
            cut_off = [failures_of(facts, "", line.arm, of)[0] for line in arms]
            points(axes, at, found, cut_off, color=one.colour, marker=one.marker, linestyle=one.line, label=told)
        axes.set_title(f"{name} tasks ({', '.join(map(str, of))})")
        axes.set_xlabel("$t_0$ (rounds)")
        axes.set_ylabel("rounds, summed")
        axes.set_ylim(bottom=0)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(methods))
    return figure


def ratios_figure(rows: Sequence[Row], scenario: Scenario) -> Figure:
    """Rounds without over with transfer, of unseen and of seen tasks, and the bills of all, literal prices, by t0.

    Ratios of means with the middle 95% over seeds drawn again; a method a colour; open where runs were cut off.
    """
    panels = {
        "rounds, unseen tasks": ("unseen", FULL),
        "rounds, seen tasks": ("seen", FULL),
        "bill, all tasks, literal prices": ("all", JOULES + literal.name),
    }
    shown = {
        title: held
        for title, key in panels.items()
        if (held := [row for row in rows if (row.tasks, row.measure) == key])
    }
    methods = list(dict.fromkeys(row.method for row in rows))
    looks = _looks([PLAIN, *methods], scenario)
    figure = new_figure(2.8)
    for axes, (title, held) in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown.items(), strict=True):
        for method, of in groupby(held, key=lambda row: row.method):
            label = method_label(scenario, method)
            _ratios(axes, list(of), methods.index(method) - len(methods) / 2, looks[method], label)
        axes.axhline(1.0, color=INK, linestyle="--", linewidth=0.7)
        axes.set_yscale("log")
        for each in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
            each(StrMethodFormatter("{x:g}"))
        axes.set_title(title)
        axes.set_xlabel("$t_0$ (rounds)")
        axes.set_ylabel("without / with transfer")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=max(1, len(methods)))
    return figure


def _ratios(axes: Axes, rows: Sequence[Row], place: float, one: Look, label: str) -> None:
    """One method's; what is infinite has no place."""
    known = [row for row in rows if np.isfinite(row.gain.of_means.value)]
    at = [row.t0 + _APART * place for row in known]
    for x, row in zip(at, known, strict=True):
        value, low, high = row.gain.of_means
        if low is not None and high is not None and np.isfinite(high):
            axes.errorbar(x, value, [[value - low], [high - value]], color=one.colour, capsize=2, elinewidth=0.8)
    values = [row.gain.of_means.value for row in known]
    drawn = {"color": one.colour, "marker": one.marker, "linestyle": one.line, "label": label}
    axes.plot(at, values, markersize=4, linewidth=1.2, **drawn)
    cut_off = [
        (x, value)
        for x, value, row in zip(at, values, known, strict=True)
        if row.mine.not_learned or row.plain.not_learned
    ]
    if cut_off:
        axes.plot(*zip(*cut_off, strict=True), **OPEN | {"marker": one.marker, "color": one.colour})


def _looks(methods: Sequence[str], scenario: Scenario) -> dict[str, Look]:
    return dict(zip(methods, looks_of([method_colour(scenario, method) for method in methods]), strict=True))
