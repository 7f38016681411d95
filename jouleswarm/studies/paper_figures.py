"""The paper's Figs. 3 and 4 from facts, and the break-even map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.report.arms import INK
from jouleswarm.report.canvas import bars, new_figure
from jouleswarm.studies.arms import PLAIN, arms_by_t0, rounds_estimate, tasks_of
from jouleswarm.studies.breakeven import Compared, gain_map
from jouleswarm.studies.estimates import Estimate, estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.paper_energy import compared_arms, energy_rows, optimum
from jouleswarm.studies.prices import PAIRS, PRICE_LISTS, facts_of, runs_of
from jouleswarm.studies.style import COLOURS, META, PLAIN_COLOUR, points

PAPER_T0 = 210
_PAIR_COLOURS = (INK, "#D55E00")
_MAP_TASKS, _MAP_RATIOS = (1.0, 5000.0), (0.01, 100.0)
_MAP_POINTS = 121


def figure_3(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> Figure:
    """Fig. 3 at the paper's t0 (else the largest): energy by each price list, and rounds; with and without."""
    t0 = shown_t0(facts)
    arms = {"with meta-learning": arms_by_t0(facts)[t0], "without": PLAIN}
    tasks = tasks_of(facts)
    figure = new_figure(5.6 * (len(lists) + 1) / 3)
    *panels, last = figure.subplots(len(lists) + 1, 1, sharex=True)
    for place, (arm, colour) in enumerate(zip(arms.values(), (META, PLAIN_COLOUR), strict=True)):
        start = Estimate(float(t0 if arm != PLAIN else 0), None, 1)
        rounds = [start, *(rounds_estimate(facts, arm, (task,)) for task in tasks)]
        shown = [*(_stage_estimates(facts, arm, energy, prices, tasks) for prices in lists), rounds]
        for axes, found in zip((*panels, last), shown, strict=True):
            means, texts = [each.mean for each in found], [f"{each.mean:.3g}" for each in found]
            bars(axes, place, len(arms), means, colour, ci95=[each.ci95 or 0.0 for each in found], texts=texts)
    for axes, prices in zip(panels, lists, strict=True):
        axes.set_ylabel(f"energy (kJ),\n{prices.label}")
    last.set_ylabel("rounds")
    names = [f"meta-learning\n($t_0$ = {t0})", *(f"task {task}" for task in tasks)]
    last.set_xticks(range(len(names)), names)
    colours = (META, PLAIN_COLOUR)
    figure.legend(
        handles=[Patch(facecolor=colour, label=name) for name, colour in zip(arms, colours, strict=True)],
        loc="outside upper right",
        ncols=2,
    )
    return figure


def figure_4a(facts: Sequence[Fact], energy: Energy, lists: Sequence[PriceList] = PRICE_LISTS) -> Figure:
    """Fig. 4a: E_ML, the sum of E_FL and E against t0, for both pairs of efficiencies; a panel a price list."""
    figure = new_figure(3.2)
    for axes, prices in zip(figure.subplots(1, len(lists), squeeze=False)[0], lists, strict=True):
        for pair, colour in zip(PAIRS, _PAIR_COLOURS, strict=True):
            rows = energy_rows(facts, energy, pair, prices)
            if rows is None:
                continue
            t0s = [float(row.t0) for row in rows]
            for part, marker, line in (("ml", "D", "-"), ("fl", "s", "-"), ("total", "", "--")):
                held = [getattr(row, part).scaled(1e-3) for row in rows]
                points(axes, t0s, held, color=colour, marker=marker, linestyle=line)
            best = optimum(rows)
            axes.plot(best.t0, best.total.mean / 1e3, marker="o", color=colour, fillstyle="none", markersize=9)
        axes.set_title(prices.label)
        axes.set_xlabel("$t_0$ (rounds)")
        axes.set_ylabel("energy (kJ)")
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_ylim(bottom=0)
    handles = [
        *(
            Patch(facecolor=c, label=f"E$_{{UL}}$/E$_{{SL}}$ {p.label}")
            for p, c in zip(PAIRS, _PAIR_COLOURS, strict=True)
        ),
        Line2D([], [], color=INK, marker="D", markersize=4, label="$E_{ML}$"),
        Line2D([], [], color=INK, marker="s", markersize=4, label="sum of $E_{FL}$"),
        Line2D([], [], color=INK, linestyle="--", label="$E$"),
        Line2D([], [], color=INK, linestyle="", marker="o", fillstyle="none", label="least $E$"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=6, columnspacing=1.0, handlelength=1.5)
    return figure


def figure_4b(facts: Sequence[Fact]) -> Figure:
    """Fig. 4b: rounds t_i against t0, a line a task."""
    figure = new_figure(2.8)
    axes = figure.subplots()
    arms = arms_by_t0(facts)
    for place, task in enumerate(tasks_of(facts)):
        found = [rounds_estimate(facts, arm, (task,)) for arm in arms.values()]
        at = [t0 + (place - len(tasks_of(facts)) / 2) for t0 in arms]  # side by side, so that no interval hides another
        points(axes, at, found, color=COLOURS[place % len(COLOURS)], marker="o", label=f"task {task}")
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
    limit = float(np.abs(found).max()) or 1.0
    mesh = axes.pcolormesh(
        tasks, ratios, found, cmap="PuOr_r", norm=TwoSlopeNorm(0, -limit, limit), shading="gouraud", rasterized=True
    )
    if found.min() < 0 < found.max():
        axes.contour(tasks, ratios, found, levels=[0.0], colors=INK, linewidths=1.4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("tasks $M$")
    axes.set_ylabel("$E_{UL} / E_{SL}$")
    chosen = f"$t_0$ = {t0}" if t0 else "best $t_0$ at each point"
    axes.set_title(f"{chosen}, $E_{{SL}}$ = {sl_bit_per_j / 1e3:g} kb/J, {prices.label}")
    ticks = np.linspace(-limit, limit, 5)
    bar = figure.colorbar(mesh, ax=axes, ticks=ticks, label="energy without / with meta-learning")
    bar.ax.set_yticklabels([f"{10**tick:.2g}" for tick in ticks])
    return figure


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
