"""The paper's Figs. 3 and 4 from facts, and the break-even map."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.report.arms import INK
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.look import look, looks_of
from jouleswarm.studies.arms import PLAIN, arms_by_t0, failures_of, rounds_estimate, tasks_of
from jouleswarm.studies.breakeven import Compared, gain_map
from jouleswarm.studies.estimates import Estimate, estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.paper_energy import compared_arms, energy_rows, optimum
from jouleswarm.studies.prices import PAIRS, PRICE_LISTS, facts_of, runs_of
from jouleswarm.studies.style import COLOURS, META, PLAIN_COLOUR, estimate_bars, points
from jouleswarm.studies.tables import at_least

PAPER_T0 = 210
_PAIR_LOOKS = ((INK, ""), ("#D55E00", "white"))
"""Colours, and what markers are filled with in place of it."""
_MAP_TASKS, _MAP_RATIOS = (1.0, 5000.0), (0.01, 100.0)
_MAP_POINTS = 121
_LEAST = 0.01  # of a colour scale, in powers of ten


def figure_3(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> Figure:
    """Fig. 3 at the paper's t0 (else the largest): energy by each price list, and rounds; with and without.

    The stage and the tasks are on scales of their own: they are a factor of hundreds apart.
    """
    t0 = shown_t0(facts)
    arms = {"with meta-learning": arms_by_t0(facts)[t0], "without": PLAIN}
    tasks = tasks_of(facts)
    figure, looks = new_figure(5.6 * (len(lists) + 1) / 3), looks_of((META, PLAIN_COLOUR))
    panels = figure.subplots(len(lists) + 1, 2, sharex="col", width_ratios=[1, len(tasks)])
    for place, (arm, one) in enumerate(zip(arms.values(), looks, strict=True)):
        start = Estimate(float(t0 if arm != PLAIN else 0), None, 1)
        rounds = [start, *(rounds_estimate(facts, arm, (task,)) for task in tasks)]
        cut_off = [0, *(failures_of(facts, "", arm, (task,))[0] for task in tasks)]
        shown = [*(_stage_estimates(facts, arm, energy, prices, tasks) for prices in lists), rounds]
        for row, found in zip(panels, shown, strict=True):
            texts = [at_least(f"{each.mean:.3g}", runs) for each, runs in zip(found, cut_off, strict=False)]
            if arm != PLAIN:
                estimate_bars(row[0], 0, 1, found[:1], one, texts[:1])
            estimate_bars(row[1], place, len(arms), found[1:], one, texts[1:])
            for axes, margin in zip(row, (0.4, 0.03), strict=True):
                axes.margins(x=margin, y=0.14)
    for (left, _), what in zip(panels, [*(f"energy (kJ),\n{each.label}" for each in lists), "rounds"], strict=True):
        left.set_ylabel(what)
    panels[-1][0].set_xticks([0], [f"meta-learning\n($t_0$ = {t0})"])
    panels[-1][1].set_xticks(range(len(tasks)), [f"task {task}" for task in tasks])
    handles = [Patch(**one.face, label=name) for name, one in zip(arms, looks, strict=True)]
    figure.legend(handles=handles, loc="outside upper right", ncols=2)
    return figure


def figure_4a(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> Figure:
    """Fig. 4a: E_ML, the sum of E_FL and E against t0, for both pairs of efficiencies; a panel a price list.

    A total among whose runs some were cut off is marked as a lower bound.
    """
    figure = new_figure(3.2)
    for axes, prices in zip(figure.subplots(1, len(lists), squeeze=False, sharey=True)[0], lists, strict=True):
        for pair, (colour, inside) in zip(PAIRS, _PAIR_LOOKS, strict=True):
            rows = sorted(energy_rows(facts, energy, pair, prices) or (), key=lambda row: row.t0)
            if not rows:
                continue
            t0s = [float(row.t0) for row in rows]
            for part, marker, line in (("ml", "D", "-"), ("fl", "s", "-"), ("total", "", "--")):
                held = [getattr(row, part).scaled(1e-3) for row in rows]
                points(axes, t0s, held, color=colour, marker=marker, markerfacecolor=inside or colour, linestyle=line)
            for row in (row for row in rows if row.not_learned):
                axes.annotate(
                    "≥", (row.t0, row.total.mean / 1e3), xytext=(3, 3), textcoords="offset points", color=colour
                )
            best = optimum(rows)
            axes.plot(best.t0, best.total.mean / 1e3, marker="o", color=colour, fillstyle="none", markersize=9)
        axes.set_title(prices.label)
        axes.set_xlabel("$t_0$ (rounds)")
        axes.set_ylabel("energy (kJ)" if prices is lists[0] else "")
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_ylim(bottom=0)
    handles = [
        *(
            Line2D([], [], color=c, marker="o", markerfacecolor=inside or c, label=f"$E_{{UL}}/E_{{SL}}$ {p.label}")
            for p, (c, inside) in zip(PAIRS, _PAIR_LOOKS, strict=True)
        ),
        Line2D([], [], color=INK, marker="D", markersize=4, label="$E_{ML}$"),
        Line2D([], [], color=INK, marker="s", markersize=4, label="sum of $E_{FL}$"),
        Line2D([], [], color=INK, linestyle="--", label="$E$"),
        Line2D([], [], color=INK, linestyle="", marker="o", fillstyle="none", label="least $E$"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=6, columnspacing=1.0, handlelength=1.5)
    return figure


def figure_4b(facts: Sequence[Fact]) -> Figure:
    """Fig. 4b: rounds t_i against t0, a line a task; an open marker is a lower bound."""
    figure = new_figure(2.8)
    axes = figure.subplots()
    arms = arms_by_t0(facts)
    for place, task in enumerate(tasks_of(facts)):
        found = [rounds_estimate(facts, arm, (task,)) for arm in arms.values()]
        cut_off = [failures_of(facts, "", arm, (task,))[0] for arm in arms.values()]
        at = [t0 + (place - len(tasks_of(facts)) / 2) for t0 in arms]  # side by side, so that no interval hides another
        one = look(place, COLOURS[place % len(COLOURS)])
        drawn = {"color": one.colour, "marker": one.marker, "linestyle": one.line, "label": f"task {task}"}
        points(axes, at, found, cut_off, **drawn)
    axes.set_xlabel("$t_0$ (rounds)")
    axes.set_ylabel("$t_i$ (rounds)")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside right center")
    return figure


def break_even_figure(
    facts: Sequence[Fact],
    energy: Energy,
    training: Sequence[int],
    sl_bit_per_j: float,
    t0: int | None = None,
    prices: PriceList = literal,
) -> Figure:
    """Energy without over energy with meta-learning by number of tasks and E_UL / E_SL, the line where it is 1.

    Without `t0` the best of those that ran is taken at each point.
    """
    tasks = np.geomspace(*_MAP_TASKS, _MAP_POINTS)
    ratios = np.geomspace(*_MAP_RATIOS, _MAP_POINTS)
    here = energy.model_copy(update={"sl_bit_per_j": sl_bit_per_j})
    found = np.log10(gain_map(_candidates(facts, training, t0), here, tasks, ratios, prices))
    figure = new_figure(3.4)
    axes = figure.subplots()
    if np.isnan(found).any():
        axes.text(0.5, 0.5, "the price list has no bill for these facts", ha="center", transform=axes.transAxes)
        axes.set_title(prices.label)
        return figure
    low, high = min(float(found.min()), -_LEAST), max(float(found.max()), _LEAST)
    mesh = axes.pcolormesh(
        tasks, ratios, found, cmap="PuOr_r", norm=TwoSlopeNorm(0, low, high), shading="gouraud", rasterized=True
    )
    _lines(axes, tasks, ratios, found)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("tasks $M$")
    axes.set_ylabel("$E_{UL} / E_{SL}$")
    chosen = f"$t_0$ = {t0}" if t0 else "best $t_0$ at each point"
    axes.set_title(f"{chosen}, $E_{{SL}}$ = {sl_bit_per_j / 1e3:g} kb/J, {prices.label}")
    ticks = [low, low / 2, 0.0, high / 2, high]
    bar = figure.colorbar(mesh, ax=axes, ticks=ticks, label="energy without / with meta-learning")
    bar.ax.set_yticklabels([f"{10**tick:.2g}" for tick in ticks])
    return figure


def _lines(axes: Axes, tasks: NDArray[np.float64], ratios: NDArray[np.float64], found: NDArray[np.float64]) -> None:
    """Lines of equal factors with their numbers, that of 1 the thickest: the map can be read in grey."""
    for factor, width in ((0.01, 0.6), (0.1, 0.6), (0.5, 0.6), (1.0, 1.6), (1.5, 0.6), (2.0, 0.6)):
        if found.min() < (level := math.log10(factor)) < found.max():
            drawn = axes.contour(tasks, ratios, found, levels=[level], colors=INK, linewidths=width, linestyles="-")
            axes.clabel(drawn, fmt=f"{factor:g}", fontsize=7)


def shown_t0(facts: Sequence[Fact]) -> int:
    """The paper's t0 where it ran, else the largest."""
    ran = arms_by_t0(facts)
    return PAPER_T0 if PAPER_T0 in ran else max(ran)


def _candidates(facts: Sequence[Fact], training: Sequence[int], t0: int | None) -> list[Compared]:
    if found := [each for each in compared_arms(facts, training) if t0 in (None, each.t0)]:
        return found
    raise StudyError(
        f"break-even: got no arm with meta-learning{f' of t0 = {t0}' if t0 else ''} beside one without, expected one; "
        f"those that ran are {', '.join(map(str, arms_by_t0(facts)))}"
    )


def _stage_estimates(
    facts: Sequence[Fact], arm: str, energy: Energy, prices: PriceList, tasks: Sequence[int]
) -> list[Estimate]:
    """kJ of the meta stage and of each task at the first pair of efficiencies, where both price lists are defined."""
    here = PAIRS[0].of(energy)

    runs = [facts_of(run) for run in runs_of(facts, "", arm).values()]
    stages = [[run.of_ml() for run in runs], *([run.of_task(task) for run in runs] for task in tasks)]
    bills = [[price(prices, stage, here) for stage in held] for held in stages]
    if any(bill is None for held in bills for bill in held):
        return []
    return [estimate(bill.total_j for bill in held if bill).scaled(1e-3) for held in bills]
