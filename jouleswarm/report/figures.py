"""Figures of a run as PNG and SVG files, and as SVG elements for `report.html`."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.report.arms import INK
from jouleswarm.report.bars import energy_figure, rounds_figure
from jouleswarm.report.curves import bytes_figure, rewards_figure
from jouleswarm.report.times import time_figure
from jouleswarm.runs.run import Run

CAPTIONS = {
    "energy": "Energy of meta-learning and of each task's learning (equations (8)-(12), measured payload bytes; "
    "closed form where nothing was metered). Plain: learning, acting and waiting; hatched: communication.",
    "rounds": "Rounds of meta-learning in the data center and rounds until each task was learned; a cross marks a "
    "task that was not.",
    "rewards": "Running reward R of each cluster by round; thin lines, with few arms, are single robots' greedy "
    "episodes; dashed is the reward at which a task counts as learned; a cross ends a task that was not.",
    "time": "Energy (equations (8)-(12), measured payload bytes) against seconds to learn, an arm a point; dashed "
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
    "hatch.linewidth": 0.6,
    "savefig.facecolor": "white",
}
_PNG_DPI = 300


_FIGURES: dict[str, Callable[[Run, Energy], Figure]] = {
    "energy": energy_figure,
    "rounds": rounds_figure,
    "rewards": rewards_figure,
    "bytes": bytes_figure,
}


def _drawn(energy: Energy) -> dict[str, Callable[[Run, Energy], Figure]]:
    return _FIGURES | ({"time": time_figure} if energy.tells_time else {})


def write_figures(run: Run, energy: Energy, suffix: str = "") -> list[Path]:
    """Draw all figures into RUN/figures; at other prices (`suffix`) only those that prices change."""
    folder = run.path / "figures"
    folder.mkdir(exist_ok=True)
    written = []
    for name, draw in _drawn(energy).items():
        if suffix and name not in ("energy", "time"):
            continue
        with matplotlib.rc_context(STYLE | {"svg.hashsalt": name}):
            figure = draw(run, energy)
            for kind, options in (("png", {"dpi": _PNG_DPI}), ("svg", {"metadata": {"Date": None}})):
                path = folder / f"{name}{suffix}.{kind}"
                figure.savefig(path, format=kind, **options)
                written.append(path)
    return written


def inline_svgs(run: Run, energy: Energy) -> dict[str, str]:
    """Figures by name as SVG elements for one HTML page: the page's text colour, no two ids alike."""
    found = {}
    for name, draw in _drawn(energy).items():
        with matplotlib.rc_context(STYLE | {"svg.hashsalt": name, "savefig.facecolor": "none"}):
            file = io.StringIO()
            draw(run, energy).savefig(file, format="svg", metadata={"Date": None}, transparent=True)
        svg = file.getvalue()
        svg = svg[svg.index("<svg") :].replace(INK, "currentColor")
        svg = re.sub(r'\bid="', f'id="{name}-', svg)
        svg = re.sub(r'href="#', f'href="#{name}-', svg)
        found[name] = re.sub(r"url\(#", f"url(#{name}-", svg)
    return found
