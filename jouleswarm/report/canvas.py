"""What all drawings share: the sheet, bars, the arms' patches, how many arms can be told apart by annotation.

Matplotlib's object interface throughout, so that no global figure state is left behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from jouleswarm.report.arms import INK, labels, looks
from jouleswarm.report.look import Look, hatched
from jouleswarm.runs.run import Run

FEW = 3
"""Up to so many arms, every bar has its number and every robot its line; beyond they would cover each other."""
SOME = 9
"""Up to so many arms, a bar has room for a number on end."""
LEGEND_COLUMNS = 4

SINGLES: dict[str, Any] = {
    "linestyle": "", "marker": "o", "markersize": 2.5, "color": "white", "markeredgecolor": INK, "markeredgewidth": 0.7
}  # fmt: skip
"""Points of single values, seen on a bar too."""

_WIDTH_IN = 7.0
_LEGEND_ROW_IN = 0.17
_BARS_WIDE = 0.84  # all bars of a group, of the distance between groups
_WIDEST_BAR = 0.38
_ABOVE: dict[str, Any] = {"ha": "center", "va": "bottom", "xytext": (0, 1.5), "textcoords": "offset points"}


def new_figure(height_in: float) -> Figure:
    """An empty figure of the report's width."""
    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def settled(figure: Figure) -> Figure:
    """The same, its axes where the layout has put them, to a millionth: the solver's last bits differ from time to
    time, and ids in an SVG are made of them."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        place = axes.get_position(original=True)
        axes.set_position(Bbox(np.round(place.get_points(), 6)))
    return figure


def bars(
    axes: Axes,
    place: int,
    among: int,
    heights: Sequence[float],
    look: Look,
    *,
    stacked: Sequence[float] = (),
    ci95: Sequence[float] = (),
    singles: Sequence[Sequence[float]] = (),
    texts: Sequence[str] = (),
    turned: bool = False,
) -> None:
    """One arm's bars, beside those of the other arms; where there is nothing there is none.

    Args:
        axes: what is drawn on; no interval goes below zero.
        place: of the arm, from 0.
        among: how many arms there are.
        heights: of the bar in each group of the x axis.
        look: of the arm.
        stacked: on top of each bar, hatched.
        ci95: half widths of the intervals; 0 for none.
        singles: values that are points beside each bar, in place of an interval.
        texts: above each bar.
        turned: have them stand on end, where bars are close.
    """
    width = min(_WIDEST_BAR, _BARS_WIDE / among)
    nothing, count = [0.0] * len(heights), len(heights)
    columns = zip(
        heights, stacked or nothing, ci95 or nothing, singles or [()] * count, texts or [""] * count, strict=True
    )
    for group, (height, above, half, held, text) in enumerate(columns):
        x, top = group + (place - (among - 1) / 2) * width, height + above
        if not top:
            continue
        axes.bar(x, height, width, **look.face)
        if above:
            axes.bar(x, above, width, bottom=height, **hatched(look.colour))
        if half:
            axes.errorbar(x, top, yerr=[[min(half, top)], [half]], color=INK, capsize=2, elinewidth=0.8)
        if held:
            axes.plot([x] * len(held), held, **SINGLES)
        if text:
            few = among <= FEW and not turned
            font = _ABOVE | ({"fontsize": 6.5} if few else {"fontsize": 5.5, "rotation": 90})
            if held:
                font["xytext"] = (0, 4)  # clear of the points
            axes.annotate(text, (x, max(top + half, *held, 0.0)), **font)


def arm_patches(run: Run) -> list[Patch]:
    """The arms' entries of a legend."""
    held = looks(run.scenario)
    return [Patch(**held[arm].face, label=name) for arm, name in labels(run.scenario).items()]


def arm_lines(run: Run) -> list[Line2D]:
    """The same of drawings whose arms are lines."""
    held = looks(run.scenario)
    return [
        Line2D([], [], color=held[arm].colour, linestyle=held[arm].line, label=name)
        for arm, name in labels(run.scenario).items()
    ]


def legend_in(arms: int) -> float:
    """Height of a legend of arms above a drawing, beyond the first row."""
    return _LEGEND_ROW_IN * ((arms - 1) // LEGEND_COLUMNS)
