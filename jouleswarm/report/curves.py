"""Curves: rewards by round, bytes over time."""

from __future__ import annotations

import math
from collections import defaultdict
from statistics import fmean

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.report.arms import INK, looks
from jouleswarm.report.canvas import FEW, LEGEND_COLUMNS, arm_lines, legend_in, new_figure
from jouleswarm.report.look import Look
from jouleswarm.runs.run import Run

LINK_STYLES = {
    Link.UPLINK: ("#D55E00", "-"),
    Link.DOWNLINK: ("#009E73", "--"),
    Link.SIDELINK: ("#CC79A7", "-."),
    Link.CONTROL: ("#7F7F7F", ":"),
}


def rewards_figure(run: Run, energy: Energy) -> Figure:
    """R by round, one panel a task. `energy` plays no part."""
    tasks = list(run.scenario.clusters)
    across = min(3, len(tasks))
    down = math.ceil(len(tasks) / across)
    figure = new_figure(1.9 * down + 0.3 + legend_in(len(run.scenario.arms)))
    grid = figure.subplots(down, across, squeeze=False, sharey=True).ravel()
    for axes, task in zip(grid, tasks, strict=False):
        for arm, look in looks(run.scenario).items():
            _reward_curves(axes, run, arm, task, look)
        axes.axhline(run.scenario.federation.target_reward, color=INK, linestyle="--", linewidth=0.7)
        axes.set_title(f"task {task}")
        axes.xaxis.get_major_locator().set_params(integer=True)
    for axes in grid[len(tasks) :]:
        axes.set_visible(False)
    for place, axes in enumerate(grid[: len(tasks)]):
        if place % across == 0:
            axes.set_ylabel("running reward R")
        if place + across >= len(tasks):
            axes.set_xlabel("round")
    figure.legend(handles=arm_lines(run), loc="outside upper right", ncols=LEGEND_COLUMNS)
    return figure


def bytes_figure(run: Run, energy: Energy) -> Figure:
    """Payload bytes received so far, by link class. `energy` plays no part."""
    figure = new_figure(2.6)
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


def _reward_curves(axes: Axes, run: Run, arm: str, task: int, look: Look) -> None:
    rows = [row for row in run.rows if (row.arm, row.task, row.phase) == (arm, task, RowPhase.FL) and row.agent != 0]
    few = len(run.scenario.arms) <= FEW
    for agent in sorted({row.agent for row in rows}) if few else ():
        points = sorted((row.round, row.reward) for row in rows if row.agent == agent and row.reward is not None)
        axes.plot(*zip(*points, strict=True) if points else ([], []), color=look.colour, linewidth=0.5, alpha=0.35)
    running: dict[int, list[float]] = defaultdict(list)
    for row in rows:
        if row.cluster_reward is not None:
            running[row.round].append(row.cluster_reward)
    # One value a round where the cluster shares R; the mean of those still learning where each robot has its own.
    curve = [(round_, fmean(values)) for round_, values in sorted(running.items())]
    if curve:
        axes.plot(*zip(*curve, strict=True), color=look.colour, linestyle=look.line, linewidth=1.6 if few else 1.0)
        (result,) = [each for each in run.results[arm] if each.task == task]
        axes.plot(*curve[-1], marker="o" if result.learned else "x", color=look.colour, markersize=4)
