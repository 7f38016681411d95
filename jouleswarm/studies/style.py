"""Colours and points of the figures of all studies; the rest is as in a run's own (`report.figures`)."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes

from jouleswarm.studies.estimates import Estimate

META, PLAIN_COLOUR = "#E69F00", "#0072B2"
"""With meta-learning and without, as in the paper."""
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#7F7F7F", "#1d1d24")
"""Okabe and Ito's set, told apart by colour-blind readers."""


def points(axes: Axes, xs: list[float], estimates: list[Estimate], **options: Any) -> None:
    """Means over seeds with their 95% intervals, joined by a line."""
    means = [found.mean for found in estimates]
    halves = [found.ci95 or 0.0 for found in estimates]
    axes.errorbar(xs, means, yerr=halves, capsize=2, elinewidth=0.8, markersize=4, linewidth=1.2, **options)
