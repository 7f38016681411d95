"""Figures of a run as PNG and SVG files, and as SVG elements for `report.html`."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from jouleswarm.common.figure_kinds import KINDS
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.report.arms import INK
from jouleswarm.report.bars import energy_figure, rounds_figure
from jouleswarm.report.canvas import settled
from jouleswarm.report.curves import bytes_figure, rewards_figure
from jouleswarm.report.spending import learned_figure
from jouleswarm.report.time_figure import time_figure
from jouleswarm.report.tornado import tornado_figure
from jouleswarm.runs.breakeven import comparable
from jouleswarm.runs.curves import curves
from jouleswarm.runs.run import Run

CAPTIONS = {
    "energy": "Energy of meta-learning and of each task's learning (equations (8)-(12), counted payload bytes; "
    "closed form where nothing was metered), each panel on a scale of its own. Full: learning, acting and waiting; "
    "pale, with slanted lines: communication.",
    "rounds": "Rounds of meta-learning in the data center and rounds until each task was learned; a cross marks a "
    "task that was not.",
    "rewards": "Running reward R of each cluster by round; thin lines, with few arms, are single robots' greedy "
    "episodes; dashed is the reward at which a task counts as learned; a cross ends a task that was not.",
    "learned": "Share of the tasks learned, and the mean of their R, by what had been spent (each round of a task has "
    "the same part of its total); curves begin when their stage is paid for.",
    "why": "What the comparison hangs on: joules with a model learned first over joules without, where one constant is "
    "halved (the arrow's end) or doubled; dashed is the verdict's turning.",
    "time": "Energy (equations (8)-(12), counted payload bytes) against seconds to learn, an arm a point; dashed "
    "through the arms that no other beats in both.",
    "bytes": "Payload bytes received by all processes so far, by link class.",
}
STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.titlesize": 8,
    "legend.frameon": False,
    "hatch.linewidth": 0.8,
    "savefig.facecolor": "white",
}
_PNG_DPI = 300


_FIGURES: dict[str, Callable[[Run, Energy], Figure]] = {
    "energy": energy_figure,
    "rounds": rounds_figure,
    "rewards": rewards_figure,
    "learned": learned_figure,
    "why": tornado_figure,
    "time": time_figure,
    "bytes": bytes_figure,
}
_OF_PRICES = ("energy", "learned", "why", "time")


def write_figures(run: Run, energy: Energy, suffix: str = "", kinds: Sequence[str] = KINDS) -> list[Path]:
    """Draw all figures, their curves as CSV too, into RUN/figures; at other prices (`suffix`) those that change."""
    folder = run.path / "figures"
    names = [name for name in _of(run, energy) if not suffix or name in _OF_PRICES]
    drawn = ((name, partial(_FIGURES[name], run, energy)) for name in names)
    written = [path for name, draw in drawn for path in save_figure(folder, f"{name}{suffix}", draw, kinds)]
    table = folder / f"learned{suffix}.csv"
    curves(run, energy).to_csv(table, index=False, float_format="%.10g")
    return [*written, table]


def save_figure(
    folder: Path, name: str, draw: Callable[[], Figure], kinds: Sequence[str] = KINDS, dpi: int = _PNG_DPI
) -> list[Path]:
    """Draw a figure and write it as files of these kinds, if any; the same data make the same files."""
    if not kinds:
        return []
    folder.mkdir(parents=True, exist_ok=True)
    options: dict[str, dict[str, Any]] = {
        "png": {"dpi": dpi},
        "svg": {"metadata": {"Date": None}},
        "pdf": {"dpi": dpi, "metadata": {"CreationDate": None}},
    }
    with matplotlib.rc_context(STYLE | {"svg.hashsalt": name}):
        figure = settled(draw())
        for kind in kinds:
            figure.savefig(folder / f"{name}.{kind}", format=kind, **options[kind])
    return [folder / f"{name}.{kind}" for kind in kinds]


def inline_svgs(run: Run, energy: Energy) -> dict[str, str]:
    """Figures by name as SVG elements for one HTML page: the page's text colour, no two ids alike."""
    found = {}
    for name in _of(run, energy):
        with matplotlib.rc_context(STYLE | {"svg.hashsalt": name, "savefig.facecolor": "none"}):
            file = io.StringIO()
            settled(_FIGURES[name](run, energy)).savefig(file, format="svg", metadata={"Date": None}, transparent=True)
        svg = file.getvalue()
        svg = svg[svg.index("<svg") :].replace(INK, "currentColor")
        svg = re.sub(r'\bid="', f'id="{name}-', svg)
        svg = re.sub(r'href="#', f'href="#{name}-', svg)
        found[name] = re.sub(r"url\(#", f"url(#{name}-", svg)
    return found


def _of(run: Run, energy: Energy) -> list[str]:
    """The figures that a run has: where nothing may be compared, there is no why, and without rates no time."""
    there = {"why": bool(comparable(run)), "time": energy.tells_time}
    return [name for name in _FIGURES if there.get(name, True)]
