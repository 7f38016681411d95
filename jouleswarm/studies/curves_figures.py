"""Figures of tasks learned against what was spent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from jouleswarm.report.canvas import new_figure
from jouleswarm.runs.curves import SPENT
from jouleswarm.studies.arms import names_of
from jouleswarm.studies.curves import Band, Curves
from jouleswarm.studies.style import COLOURS

_TWO_ROWS_IN, _ROW_IN, _LEGEND_COLUMNS = 4.4, 1.3, 7


class Row(NamedTuple):
    """A row of panels, one for each thing that is spent."""

    label: str
    variant: str
    statistic: int
    """Of `Profile`."""


def curves_figures(
    found: Mapping[str, Curves], groups: Mapping[str, Mapping[str, str]]
) -> dict[str, Callable[[], Figure]]:
    """By the name of their files; none where nothing was learned.

    Args:
        found: of a study.
        groups: what was varied -> its value -> its variant: a figure each. One value alone is shown by both statistics.
    """
    variants = list(dict.fromkeys(arm.variant for each in found.values() for arm in each.arms))
    varied = {f"curves_{what}": of for what, of in groups.items()} or {"curves": {each: each for each in variants}}
    figures: dict[str, Callable[[], Figure]] = {}
    for name, of in varied.items():
        shown = {value: variant for value, variant in of.items() if variant in variants}
        if shown:
            figures[name] = partial(curves_figure, found, _rows(name.removeprefix("curves_"), shown))
    return figures


def _rows(what: str, shown: Mapping[str, str]) -> list[Row]:
    if len(shown) == 1:
        (variant,) = shown.values()
        told = ("interquartile mean", 1), ("share", 0)
        return [Row(f"tasks learned (%),\n{name}", variant, statistic) for name, statistic in told]
    return [Row(f"{what} = {value}", variant, 1) for value, variant in shown.items()]


def curves_figure(found: Mapping[str, Curves], rows: Sequence[Row]) -> Figure:
    """Tasks learned with their band against what was spent; an arm a colour.

    Two rows are the interquartile mean over the share, more of them the interquartile mean of a variant each.
    """
    figure = new_figure(max(_TWO_ROWS_IN, _ROW_IN * len(rows) + 1))
    grid = figure.subplots(len(rows), len(found), sharex="col", sharey=True, squeeze=False)
    for row, panels in zip(rows, grid, strict=True):
        for axes, curves in zip(panels, found.values(), strict=True):
            _draw(axes, curves, row)
        panels[0].set_ylabel(row.label)
    for axes, what in zip(grid[-1], found, strict=True):
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(SPENT[what])
    handles, labels = grid[0][0].get_legend_handles_labels()
    columns = min(len(handles), _LEGEND_COLUMNS)
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, columnspacing=1.0, handlelength=1.5)
    if len({row.statistic for row in rows}) == 1:
        figure.supylabel("tasks learned (%), interquartile mean", fontsize="medium")
    return figure


def _draw(axes: Axes, curves: Curves, row: Row) -> None:
    names = names_of(arm for arm in curves.arms if arm.variant == row.variant)
    for place, (arm, name) in enumerate(names.items()):
        band: Band = curves.arms[arm][row.statistic]
        colour, line = COLOURS[place % len(COLOURS)], "-" if place < len(COLOURS) else "--"
        told = name.replace("t0", "$t_0$")
        axes.fill_between(
            curves.budgets, 100 * band[1], 100 * band[2], step="post", alpha=0.2, color=colour, linewidth=0
        )
        axes.step(curves.budgets, 100 * band[0], line, where="post", color=colour, linewidth=1.2, label=told)
