"""Task maps with robots that follow the path of the greedy policy they have learned (the landmarks only)."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import NamedTuple

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.maps import Cell, TaskMap
from jouleswarm.environments.landmarks.settings import task_map
from jouleswarm.runs.paths import LANDMARKS

_CELL, _EDGE = 32, 6
_SECONDS = 0.6
"""That a drawn robot takes for a motion."""


def has_maps(scenario: Scenario) -> bool:
    """Whether there is anything to draw."""
    return scenario.environment == LANDMARKS


class Walk(NamedTuple):
    """A greedy episode of an arm."""

    label: str
    colour: str
    cells: tuple[Cell, ...]
    is_learning: bool = False


def map_svg(scenario: Scenario, task: int, walks: Sequence[Walk]) -> str:
    """A task's map, and on it the walks of those arms that have one; dashed of those that go on learning."""
    drawn = task_map(scenario, task)
    width, height = drawn.cols * _CELL + 2 * _EDGE, drawn.rows * _CELL + 2 * _EDGE
    cells = "".join(_cell(drawn, (row, col)) for row in range(drawn.rows) for col in range(drawn.cols))
    paths = "".join(_walk(number, len(walks), walk) for number, walk in enumerate(walks))
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    return f'<svg {size} class="map" role="img" aria-label="map of task {task}">{cells}{paths}</svg>'


def _cell(drawn: TaskMap, cell: Cell) -> str:
    row, col = cell
    kind = "obstacle" if cell in drawn.obstacles else "path" if cell in drawn.path else "floor"
    x, y = _EDGE + col * _CELL, _EDGE + row * _CELL
    letter = {drawn.entry: "E", drawn.exit: "X"}.get(cell, "")
    text = f'<text x="{x + _CELL / 2:g}" y="{y + _CELL / 2 + 4.5:g}">{letter}</text>' if letter else ""
    return f'<rect x="{x + 1}" y="{y + 1}" width="{_CELL - 2}" height="{_CELL - 2}" rx="3" class="{kind}"/>{text}'


def _walk(number: int, of: int, walk: Walk) -> str:
    """A line through the landmarks and a robot that goes along it again and again; arms lie side by side."""
    aside, motions = 5.0 * (number - (of - 1) / 2), len(walk.cells) - 1
    way = "M " + " L ".join(f"{x:.1f} {y:.1f}" for x, y in (_point(cell, aside) for cell in walk.cells))
    told = html.escape(f"{walk.label}: {motions} motions" + (", still learning" if walk.is_learning else ""))
    dashes = ' stroke-dasharray="4 4"' if walk.is_learning else ""
    look = f'fill="none" stroke="{walk.colour}" stroke-width="2.5" stroke-linejoin="round"{dashes}'
    motion = f'<animateMotion dur="{_SECONDS * max(1, motions):.1f}s" repeatCount="indefinite" path="{way}"/>'
    robot = f'<circle r="6" fill="{walk.colour}" class="walker">{motion}</circle>'
    return f'<g><title>{told}</title><path d="{way}" {look}/>{robot}</g>'


def _point(cell: Cell, aside: float) -> tuple[float, float]:
    row, col = cell
    return _EDGE + (col + 0.5) * _CELL + aside, _EDGE + (row + 0.5) * _CELL + aside
