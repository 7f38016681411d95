"""Colours and points of the figures of all studies; the rest is as in a run's own (`report.figures`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes

from jouleswarm.report.canvas import SINGLES, bars
from jouleswarm.report.look import Look
from jouleswarm.studies.estimates import Estimate

META, PLAIN_COLOUR = "#E69F00", "#0072B2"
"""With meta-learning and without, as in the paper."""
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#7F7F7F", "#1d1d24")
"""Okabe and Ito's set, told apart by colour-blind readers."""

OPEN: dict[str, Any] = {"linestyle": "", "markersize": 4, "markerfacecolor": "white", "zorder": 3}
"""Markers of lower bounds."""


def points(
    axes: Axes, xs: Sequence[float], estimates: Sequence[Estimate], bounds: Sequence[int] = (), **options: Any
) -> None:
    """Means over seeds with their 95% intervals, joined by a line; of three seeds or fewer each one's value.

    `bounds`: how many runs of each were cut off; with any the mean is a lower bound, and its marker open.
    """
    means, halves = [found.mean for found in estimates], [found.drawn_ci95 for found in estimates]
    spread: dict[str, Any] = {"yerr": halves} if any(halves) else {}
    axes.errorbar(xs, means, **spread, capsize=2, elinewidth=0.8, markersize=4, linewidth=1.2, **options)
    cut_off = [(x, mean) for x, mean, runs in zip(xs, means, bounds or [0] * len(means), strict=True) if runs]
    if cut_off:
        axes.plot(*zip(*cut_off, strict=True), **OPEN | {"marker": options["marker"], "color": options["color"]})
    held = [(x, value) for x, found in zip(xs, estimates, strict=True) for value in found.singles]
    if held:
        axes.plot(*zip(*held, strict=True), **SINGLES | {"markeredgecolor": options["color"]})


def estimate_bars(
    axes: Axes,
    place: int,
    among: int,
    found: Sequence[Estimate],
    look: Look,
    texts: Sequence[str] = (),
    *,
    turned: bool = False,
) -> None:
    """One arm's means as bars, with their intervals, or of three seeds or fewer each one's value."""
    halves, singles = [each.drawn_ci95 for each in found], [each.singles for each in found]
    means = [each.mean for each in found]
    bars(axes, place, among, means, look, ci95=halves, singles=singles, texts=texts, turned=turned)
