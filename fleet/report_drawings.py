"""The drawings: energy and rounds as the paper's Fig. 3, reward curves, bytes over time.

Matplotlib's object interface throughout, so that no global figure state is left behind. Colours are from Okabe and
Ito's set, told apart by colour-blind readers: orange with MAML and blue without, as in the paper.
"""

from __future__ import annotations

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from common.energy import bill
from common.settings import Energy
from common.topics import Link
from fleet.expected import expected_counts, scenario_sizes
from fleet.pricing import counts
from fleet.report_columns import closed_parts, measured_parts
from fleet.report_data import Run
from fleet.report_text import ARM_NAMES

ARM_COLOURS = {"maml": "#E69F00", "fl": "#0072B2"}
LINK_STYLES = {
    Link.UPLINK: ("#D55E00", "-"),
    Link.DOWNLINK: ("#009E73", "--"),
    Link.SIDELINK: ("#CC79A7", "-"),
    Link.CONTROL: ("#7F7F7F", ":"),
}
INK = "#1d1d24"
_BAR = 0.38
_KILO_FROM_J = 10_000
Bars = dict[str, list[tuple[float, float]]]  # arm -> (learning, communication) joules of each bar
_WIDTH_IN = 7.0
_ABOVE: dict[str, Any] = {
    "ha": "center",
    "va": "bottom",
    "fontsize": 6.5,
    "xytext": (0, 1.5),
    "textcoords": "offset points",
}


def energy_figure(run: Run, energy: Energy) -> Figure:
    """Fig. 3a: E_ML and E_FL(t_i), arm beside arm, and the totals."""
    figure = _figure(2.6)
    left, right = figure.subplots(1, 2, width_ratios=[4.5, 1])
    labels = [r"$E_\mathrm{ML}$", *(rf"$E_\mathrm{{FL}}(t_{{{task}}})$" for task in run.scenario.clusters)]
    bars: Bars = {arm: _stage_bars(run, arm, energy) for arm in run.scenario.arm_names}
    totals: Bars = {
        arm: [(math.fsum(learning for learning, _ in held), math.fsum(carrying for _, carrying in held))]
        for arm, held in bars.items()
    }
    unit, factor = ("kJ", 1e3) if max(sum(held[0]) for held in totals.values()) >= _KILO_FROM_J else ("J", 1.0)
    for axes, held, names in ((left, bars, labels), (right, totals, ["$E$, eq. (12)"])):
        _energy_bars(axes, held, factor)
        axes.set_xticks(range(len(names)), names)
        axes.margins(x=0.02 if axes is left else 0.25, y=0.14)
    left.set_ylabel(f"energy ({unit})")
    causes = [Patch(facecolor="#bbbbbb", label="learning"), Patch(**_hatched("#bbbbbb"), label="communication")]
    left.legend(handles=[*_arm_patches(run), *causes], ncols=2, loc="best")
    return figure


def rounds_figure(run: Run, energy: Energy) -> Figure:
    """Fig. 3b: t0 and t_i, arm beside arm. `energy` plays no part."""
    figure = _figure(2.4)
    axes = figure.subplots()
    for place, arm in enumerate(run.scenario.arm_names):
        values = [float(run.t0) if arm == "maml" else 0.0, *run.rounds(arm).values()]
        learned = [True, *(result.learned for result in run.results[arm])]
        for x, (value, done) in enumerate(zip(values, learned, strict=True)):
            at = x + _offset(place, run)
            if value:
                axes.bar(at, value, _BAR, color=ARM_COLOURS[arm])
                axes.annotate(f"{value:g}" if done else f"{value:g} ×", (at, value), **_ABOVE)
    axes.set_xticks(
        range(len(run.scenario.clusters) + 1), ["$t_0$", *(f"$t_{{{task}}}$" for task in run.scenario.clusters)]
    )
    axes.set_ylabel("rounds")
    axes.margins(x=0.02, y=0.14)
    marked = any(not result.learned for results in run.results.values() for result in results)
    unlearned = [Line2D([], [], marker="x", color=INK, linestyle="", markersize=4, label="not learned")]
    axes.legend(handles=[*_arm_patches(run), *(unlearned if marked else [])], loc="best")
    return figure


def rewards_figure(run: Run, energy: Energy) -> Figure:
    """R by FL round, one panel a task. `energy` plays no part."""
    tasks = list(run.scenario.clusters)
    across = min(3, len(tasks))
    down = math.ceil(len(tasks) / across)
    figure = _figure(1.9 * down + 0.3)
    grid = figure.subplots(down, across, squeeze=False, sharey=True).ravel()
    for axes, task in zip(grid, tasks, strict=False):
        for arm in run.scenario.arm_names:
            _reward_curves(axes, run, arm, task)
        axes.axhline(run.scenario.federation.target_reward, color=INK, linestyle="--", linewidth=0.7)
        axes.set_title(f"task {task}")
        axes.xaxis.get_major_locator().set_params(integer=True)
    for axes in grid[len(tasks) :]:
        axes.set_visible(False)
    for place, axes in enumerate(grid[: len(tasks)]):
        if place % across == 0:
            axes.set_ylabel("running reward R")
        if place + across >= len(tasks):
            axes.set_xlabel("FL round")
    figure.legend(handles=_arm_patches(run), loc="outside upper right", ncols=2)
    return figure


def bytes_figure(run: Run, energy: Energy) -> Figure:
    """Payload bytes received so far, by link class. `energy` plays no part."""
    figure = _figure(2.6)
    axes = figure.subplots()
    times_s = [point.time_s for point in run.progress]
    for link, (colour, line) in LINK_STYLES.items():
        megabytes = [point.bytes.get(link, 0) / 1e6 for point in run.progress]
        if any(megabytes):
            shown = [value or math.nan for value in megabytes]  # a logarithmic axis has no zero
            axes.plot(
                times_s, shown, color=colour, linestyle=line, linewidth=1.2, drawstyle="steps-post", label=link.value
            )
    if not times_s:
        axes.text(0.5, 0.5, "nothing was recorded over time", ha="center", transform=axes.transAxes)
    else:
        axes.set_yscale("log")
        axes.margins(x=0.01)
        figure.legend(loc="outside right center")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("payload received (MB)")
    return figure


def _figure(height_in: float) -> Figure:
    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _stage_bars(run: Run, arm: str, energy: Energy) -> list[tuple[float, float]]:
    """(learning, communication) joules of E_ML, then of each task."""
    parts = measured_parts(run, arm, energy) if run.meter_rows else closed_parts(run, arm, energy)
    bars = [(parts["ml_learning"] or 0.0, parts["ml_communication"] or 0.0)]
    for task, rounds in run.rounds(arm).items():
        if run.meter_rows:
            found = counts(run.rows, run.meter_rows, arm, task=task)
        else:
            found = expected_counts(run.scenario, 0, {task: rounds}, scenario_sizes(run.scenario))
        priced = bill(found, energy)
        bars.append((priced.fl_learning_j, priced.fl_communication_j))
    return bars


def _energy_bars(axes: Axes, bars: Bars, factor: float) -> None:
    for place, (arm, held) in enumerate(bars.items()):
        for x, (learning_j, communication_j) in enumerate(held):
            at = x + (place - (len(bars) - 1) / 2) * _BAR
            total = (learning_j + communication_j) / factor
            if total == 0:
                continue
            axes.bar(at, learning_j / factor, _BAR, color=ARM_COLOURS[arm])
            axes.bar(at, communication_j / factor, _BAR, bottom=learning_j / factor, **_hatched(ARM_COLOURS[arm]))
            axes.annotate(f"{total:.3g}" if total < 1000 else f"{total:.0f}", (at, total), **_ABOVE)


def _reward_curves(axes: Axes, run: Run, arm: str, task: int) -> None:
    colour = ARM_COLOURS[arm]
    rows = [row for row in run.rows if (row.arm, row.task, row.phase) == (arm, task, "fl")]
    for agent in sorted({row.agent for row in rows}):
        points = sorted((row.round, row.reward) for row in rows if row.agent == agent and row.reward is not None)
        axes.plot(*zip(*points, strict=True) if points else ([], []), color=colour, linewidth=0.5, alpha=0.35)
    running = {row.round: row.cluster_reward for row in rows if row.cluster_reward is not None}
    curve = sorted(running.items())
    if curve:
        axes.plot(*zip(*curve, strict=True), color=colour, linewidth=1.6)
        (result,) = [each for each in run.results[arm] if each.task == task]
        axes.plot(*curve[-1], marker="o" if result.learned else "x", color=colour, markersize=4)


def _arm_patches(run: Run) -> list[Patch]:
    return [Patch(facecolor=ARM_COLOURS[arm], label=ARM_NAMES[arm]) for arm in run.scenario.arm_names]


def _hatched(colour: str) -> dict[str, Any]:
    return {
        "facecolor": (*to_rgb(colour), 0.35),
        "edgecolor": colour,
        "hatch": "/////",
        "linewidth": 0,
    }


def _offset(place: int, run: Run) -> float:
    return (place - (len(run.scenario.arm_names) - 1) / 2) * _BAR
