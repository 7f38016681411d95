"""One look for the figures of all studies: that of a run's own figures, and how they are written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jouleswarm.common.errors import StudyError
from jouleswarm.report.arms import INK
from jouleswarm.report.figures import STYLE
from jouleswarm.studies.estimates import Estimate

__all__ = ["COLOURS", "INK", "META", "PLAIN_COLOUR", "points", "write_figure"]

META, PLAIN_COLOUR = "#E69F00", "#0072B2"
"""With meta-learning and without, as in the paper."""
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#7F7F7F", "#1d1d24")
"""Okabe and Ito's set, told apart by colour-blind readers."""

Draw = Callable[[], Figure]
_PNG_DPI = 200


def points(axes: Axes, xs: list[float], estimates: list[Estimate], **options: Any) -> None:
    """Means over seeds with their 95% intervals, joined by a line."""
    means = [found.mean for found in estimates]
    halves = [found.ci95 or 0.0 for found in estimates]
    axes.errorbar(xs, means, yerr=halves, capsize=2, elinewidth=0.8, markersize=4, linewidth=1.2, **options)


def write_figure(folder: Path, name: str, draw: Draw) -> list[Path]:
    """Draw a figure and write it as PNG and as SVG; the same facts make the same files.

    Raises:
        StudyError: a file cannot be written.
    """
    with matplotlib.rc_context(STYLE | {"svg.hashsalt": name}):
        figure = draw()
        written = []
        for kind, options in (("png", {"dpi": _PNG_DPI}), ("svg", {"metadata": {"Date": None}})):
            path = folder / f"{name}.{kind}"
            try:
                folder.mkdir(parents=True, exist_ok=True)
                figure.savefig(path, format=kind, **options)
            except OSError as error:
                raise StudyError(f"cannot write {path}: {error.strerror}; name another results folder") from error
            written.append(path)
    return written
