"""Figures of tasks learned, and of R, against what was spent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from jouleswarm.common.doors import SHIPPED
from jouleswarm.common.scenario.arms import method_of
from jouleswarm.report.canvas import new_figure
from jouleswarm.report.look import look
from jouleswarm.runs.curves import SPENT
from jouleswarm.studies.arms import ArmOf, names_of
from jouleswarm.studies.curves import Curves
from jouleswarm.studies.estimates import FEW_SEEDS
from jouleswarm.studies.style import COLOURS

Statistic = Literal["share", "iqm", "reward"]
_TOLD: dict[Statistic, str] = {
    "iqm": "tasks learned (%),\ninterquartile mean",
    "share": "tasks learned (%),\nshare",
    "reward": "R of all tasks,\ninterquartile mean",
}
_ROW_IN, _TWO_ROWS_IN, _LEGEND_IN, _LEGEND_COLUMNS = 1.3, 4.4, 1.0, 7


class Row(NamedTuple):
    """A row of panels, one for each thing that is spent."""

    label: str
    variant: str
    statistic: Statistic


def curves_figures(
    found: Mapping[str, Curves], groups: Mapping[str, Mapping[str, str]]
) -> dict[str, Callable[[], Figure]]:
    """By the name of their files: `curves` of tasks learned and, where it is known, `rewards` of R.

    Args:
        found: of a study; of none where nothing was learned there is no figure.
        groups: what was varied -> its value -> its variant. A figure each, with a row a value; of one value tasks
            learned are shown by both statistics.
    """
    arms = [arm for curves in found.values() for arm in curves.arms]
    variants = dict.fromkeys(arm.variant for arm in arms)
    known = {each for curves in found.values() for each, of in curves.arms.items() if not np.isnan(of.reward[0]).all()}
    varied = {f"_{what}": of for what, of in groups.items()} or {"": {each: each for each in variants}}
    figures: dict[str, Callable[[], Figure]] = {}
    for name, of in varied.items():
        shown = {f"{name[1:]} = {value}": variant for value, variant in of.items() if variant in variants}
        learned: tuple[Statistic, ...] = ("iqm", "share") if len(shown) == 1 else ("iqm",)
        if shown:
            figures[f"curves{name}"] = partial(curves_figure, found, _rows(shown, learned))
        if any(arm.variant in shown.values() for arm in known):
            figures[f"rewards{name}"] = partial(curves_figure, found, _rows(shown, ("reward",)))
    return figures


def by_method(found: Mapping[str, Curves]) -> dict[str, Mapping[str, Curves]]:
    """End of a file's name -> what is in its figures: a method each, beside the arms without a stage, where several
    methods have several t0 each; else all."""
    arms = dict.fromkeys(arm for curves in found.values() for arm in curves.arms)
    ran = dict.fromkeys(method_of(arm.arm) for arm in arms if arm.t0)
    methods = [method for method in dict.fromkeys([*SHIPPED["methods"], *ran]) if method in ran]
    several = all(len({arm.arm for arm in arms if method_of(arm.arm) == method}) > 1 for method in methods)
    if len(methods) < 2 or not several:
        return {"": found}

    def of(method: str) -> dict[str, Curves]:
        return {
            what: curves._replace(
                arms={arm: each for arm, each in curves.arms.items() if not arm.t0 or method_of(arm.arm) == method}
            )
            for what, curves in found.items()
        }

    return {f"-{method}" if place else "": of(method) for place, method in enumerate(methods)}


def _rows(shown: Mapping[str, str], statistics: Sequence[Statistic]) -> list[Row]:
    if len(shown) == 1:
        (variant,) = shown.values()
        return [Row(_TOLD[statistic], variant, statistic) for statistic in statistics]
    return [Row(value.removeprefix(" = "), variant, statistics[0]) for value, variant in shown.items()]


def curves_figure(found: Mapping[str, Curves], rows: Sequence[Row]) -> Figure:
    """A statistic, of more than a few seeds with its band, against what was spent; an arm a colour and a line."""
    figure = new_figure(_TWO_ROWS_IN if len(rows) == 2 else _ROW_IN * max(2, len(rows)) + _LEGEND_IN)
    grid = figure.subplots(len(rows), len(found), sharex="col", sharey=True, squeeze=False)
    shown: dict[str, Artist] = {}
    for row, panels in zip(rows, grid, strict=True):
        names = names_of(
            dict.fromkeys(arm for each in found.values() for arm in each.arms if arm.variant == row.variant)
        )
        for axes, curves in zip(panels, found.values(), strict=True):
            _draw(axes, curves, names, row.statistic)
            shown |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
        panels[0].set_ylabel(row.label)
    for axes, what in zip(grid[-1], found, strict=True):
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(SPENT[what])
    columns = min(len(shown), _LEGEND_COLUMNS)
    figure.legend(
        list(shown.values()),
        list(shown),
        loc="outside upper center",
        ncols=columns,
        columnspacing=1.0,
        handlelength=1.5,
    )
    if len({row.variant for row in rows}) > 1:
        figure.supylabel(_TOLD[rows[0].statistic].replace("\n", " "), fontsize="medium")
    return figure


def _draw(axes: Axes, curves: Curves, names: Mapping[ArmOf, str], statistic: Statistic) -> None:
    for place, (arm, name) in enumerate(names.items()):
        if arm in curves.arms:
            band = getattr(curves.arms[arm], statistic) * (1 if statistic == "reward" else 100)
            one = look(place, COLOURS[place % len(COLOURS)])
            told = name.replace("t0", "$t_0$")
            if curves.seeds[arm] > FEW_SEEDS:
                axes.fill_between(
                    curves.budgets, band[1], band[2], step="post", alpha=0.2, color=one.colour, linewidth=0
                )
            drawn = {"color": one.colour, "linestyle": one.line, "linewidth": 1.2, "label": told}
            axes.step(curves.budgets, band[0], where="post", **drawn)
