"""What all drawings share: the sheet, the arms' patches, how many arms can be told apart by annotation.

Matplotlib's object interface throughout, so that no global figure state is left behind.
"""

from __future__ import annotations

from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jouleswarm.report.arms import colours, labels
from jouleswarm.runs.run import Run

FEW = 3
"""Up to so many arms, every bar has its number and every robot its line; beyond they would cover each other."""
SOME = 9
"""Up to so many arms, a bar has room for a number on end."""
LEGEND_COLUMNS = 4

_WIDTH_IN = 7.0
_LEGEND_ROW_IN = 0.17


def new_figure(height_in: float) -> Figure:
    """An empty figure of the report's width."""
    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def arm_patches(run: Run) -> list[Patch]:
    """The arms' entries of a legend."""
    held = colours(run.scenario)
    return [Patch(facecolor=held[arm], label=name) for arm, name in labels(run.scenario).items()]


def legend_in(arms: int) -> float:
    """Height of a legend of arms above a drawing, beyond the first row."""
    return _LEGEND_ROW_IN * ((arms - 1) // LEGEND_COLUMNS)


def hatched(colour: str) -> dict[str, Any]:
    """The look of communication, for a bar or a patch."""
    return {
        "facecolor": (*to_rgb(colour), 0.35),
        "edgecolor": colour,
        "hatch": "/////",
        "linewidth": 0,
    }
