"""Curves of what was learned against what was spent."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.report.arms import INK, looks
from jouleswarm.report.canvas import LEGEND_COLUMNS, arm_lines, legend_in, new_figure
from jouleswarm.runs.curves import SPENT, curves
from jouleswarm.runs.run import Run


def learned_figure(run: Run, energy: Energy) -> Figure:
    """Share of tasks learned, and the mean R, against all that is known to have been spent."""
    points = curves(run, energy)
    known = {what: heading for what, heading in SPENT.items() if points[what].notna().all()}
    figure = new_figure(3.6 + legend_in(len(run.scenario.arms)))
    grid = figure.subplots(2, max(1, len(known)), sharex="col", sharey="row", squeeze=False)
    for column, (what, heading) in enumerate(known.items()):
        upper, lower = grid[0][column], grid[1][column]
        for arm, look in looks(run.scenario).items():
            rows = points[(points["arm"] == arm) & (points[what] > 0)]
            drawn = {"color": look.colour, "linestyle": look.line, "linewidth": 1.2}
            upper.step(rows[what], 100 * rows["share_learned"], where="post", **drawn)
            lower.plot(rows[what], rows["reward"], **drawn)
        lower.axhline(run.scenario.federation.target_reward, color=INK, linestyle="--", linewidth=0.7)
        lower.set_xlabel(heading)
        if (points[what] > 0).any():
            lower.set_xscale("log")
            lower.xaxis.set_minor_formatter(NullFormatter())  # of a short axis they would cover each other
    grid[0][0].set_ylabel("tasks learned (%)")
    grid[1][0].set_ylabel("mean R")
    figure.legend(handles=arm_lines(run), loc="outside upper right", ncols=LEGEND_COLUMNS)
    return figure
