"""Bars, arm beside arm: energy and rounds as the paper's Fig. 3."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.energy.equations import Cost, bill, price
from jouleswarm.report.arms import INK, colours
from jouleswarm.report.canvas import FEW, LEGEND_COLUMNS, SOME, arm_patches, hatched, legend_in, new_figure
from jouleswarm.report.tables import NOT_LEARNED
from jouleswarm.runs.beta import with_beta
from jouleswarm.runs.facts import meta_counts, task_counts
from jouleswarm.runs.run import Run
from jouleswarm.runs.sizes import expected_counts, scenario_sizes

_BARS_WIDE = 0.84  # all bars of a group, of the distance between groups
_WIDEST_BAR = 0.38
_KILO_FROM_J = 10_000
_ABOVE: dict[str, Any] = {
    "ha": "center",
    "va": "bottom",
    "fontsize": 6.5,
    "xytext": (0, 1.5),
    "textcoords": "offset points",
}
Bars = dict[str, list[tuple[float, float]]]  # arm -> (learning, communication) joules of each bar


def energy_figure(run: Run, energy: Energy) -> Figure:
    """Fig. 3a: E_ML and E_FL(t_i), arm beside arm, and the totals."""
    few = len(run.scenario.arms) <= FEW
    figure = new_figure(2.6 if few else 3.0 + legend_in(len(run.scenario.arms) + 2))
    left, right = figure.subplots(1, 2, width_ratios=[4.5, 1 if few else 1.6])
    bars: Bars = {arm: _stage_bars(run, arm, energy) for arm in run.scenario.arm_names}
    totals: Bars = {
        arm: [(math.fsum(learning for learning, _ in held), math.fsum(carrying for _, carrying in held))]
        for arm, held in bars.items()
    }
    unit, factor = ("kJ", 1e3) if max(sum(held[0]) for held in totals.values()) >= _KILO_FROM_J else ("J", 1.0)
    labels = [rf"$E_\mathrm{{FL}}(t_{{{task}}})$" for task in run.scenario.clusters]
    stages = [r"$E_\mathrm{ML}$", *labels] if run.scenario.meta_methods else labels
    for axes, held, names in ((left, bars, stages), (right, totals, ["$E$, eq. (12)"])):
        _energy_bars(axes, held, factor, colours(run.scenario), numbered=few or axes is right)
        axes.set_xticks(range(len(names)), names)
        axes.margins(x=0.02 if axes is left else 0.25 if few else 0.05, y=0.14)
    left.set_ylabel(f"energy ({unit})")
    causes = [Patch(facecolor="#bbbbbb", label="learning"), Patch(**hatched("#bbbbbb"), label="communication")]
    _legend(figure, left, [*arm_patches(run), *causes], few)
    return figure


def rounds_figure(run: Run, energy: Energy) -> Figure:
    """Fig. 3b: t0 and t_i, arm beside arm. `energy` plays no part."""
    few = len(run.scenario.arms) <= FEW
    figure = new_figure(2.4 if few else 2.8 + legend_in(len(run.scenario.arms) + 1))
    axes = figure.subplots()
    held, meta = colours(run.scenario), bool(run.scenario.meta_methods)
    for place, arm in enumerate(run.scenario.arm_names):
        values = [float(run.t0[arm])] * meta + list(run.rounds(arm).values())
        learned = [True] * meta + [result.learned for result in run.results[arm]]
        at, width = _places(place, len(held), len(values))
        for x, value, done in zip(at, values, learned, strict=True):
            if value:
                axes.bar(x, value, width, color=held[arm])
                number = f"{value:g}" if len(held) <= SOME else ""
                text = number if done else f"{number} {NOT_LEARNED}"
                axes.annotate(text, (x, value), **_above(len(held)))
    names = ["$t_0$"] * meta + [f"$t_{{{task}}}$" for task in run.scenario.clusters]
    axes.set_xticks(range(len(names)), names)
    axes.set_ylabel("rounds")
    axes.margins(x=0.02, y=0.14)
    marked = any(not result.learned for results in run.results.values() for result in results)
    unlearned = [Line2D([], [], marker="x", color=INK, linestyle="", markersize=4, label="not learned")]
    _legend(figure, axes, [*arm_patches(run), *(unlearned if marked else [])], few)
    return figure


def _stage_bars(run: Run, arm: str, energy: Energy) -> list[tuple[float, float]]:
    """(learning, communication) joules of E_ML where any arm has one, then of each task."""
    costs = []
    if run.scenario.meta_methods:
        costs.append(_meta_cost(run, arm, energy))
    costs += [_task_cost(run, arm, task, energy) for task in run.scenario.clusters]
    return [(cost.learning_j, cost.communication_j) for cost in costs]


def _meta_cost(run: Run, arm: str, energy: Energy) -> Cost:
    energy = with_beta(energy, run.rows, arm)
    if run.meter_rows:
        return price(meta_counts(run.rows, run.meter_rows, arm), energy)
    sizes, rounds = scenario_sizes(run.scenario), run.rounds(arm)
    return bill(expected_counts(run.scenario, method_of(arm), run.t0[arm], rounds, sizes), energy).ml


def _task_cost(run: Run, arm: str, task: int, energy: Energy) -> Cost:
    energy = with_beta(energy, run.rows, arm)
    if run.meter_rows:
        return price(task_counts(run.rows, run.meter_rows, arm, task=task), energy)
    rounds = {task: run.mean_rounds(arm)[task]}
    return bill(expected_counts(run.scenario, method_of(arm), 0, rounds, scenario_sizes(run.scenario)), energy).fl


def _energy_bars(axes: Axes, bars: Bars, factor: float, held: dict[str, str], *, numbered: bool) -> None:
    for place, (arm, parts) in enumerate(bars.items()):
        at, width = _places(place, len(bars), len(parts))
        for x, (learning_j, communication_j) in zip(at, parts, strict=True):
            total = (learning_j + communication_j) / factor
            if total == 0:
                continue
            axes.bar(x, learning_j / factor, width, color=held[arm])
            axes.bar(x, communication_j / factor, width, bottom=learning_j / factor, **hatched(held[arm]))
            if numbered:
                axes.annotate(f"{total:.3g}" if total < 1000 else f"{total:.0f}", (x, total), **_above(len(bars)))


def _places(place: int, arms: int, groups: int) -> tuple[list[float], float]:
    """Where the bars of the arm in `place` stand, and how wide they are."""
    width = min(_WIDEST_BAR, _BARS_WIDE / arms)
    return [group + (place - (arms - 1) / 2) * width for group in range(groups)], width


def _above(arms: int) -> dict[str, Any]:
    return _ABOVE if arms <= FEW else _ABOVE | {"rotation": 90, "fontsize": 5.5}


def _legend(figure: Figure, axes: Axes, handles: list[Any], few: bool) -> None:
    if few:
        axes.legend(handles=handles, ncols=2, loc="best")
    else:
        figure.legend(handles=handles, ncols=LEGEND_COLUMNS, loc="outside upper center")
