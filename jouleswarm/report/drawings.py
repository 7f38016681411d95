"""SVG drawings of a run's world: the task maps with the learned paths, and who is linked to whom."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from markupsafe import Markup

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.environments.landmarks.settings import task_map
from jouleswarm.methods.graph import task_graph
from jouleswarm.report.arms import labels, looks
from jouleswarm.report.look import dashes

_CELL, _EDGE = 28, 4
_MOST_CLUSTERS = 24
_RADIUS, _ROBOT, _WIDE = 34, 9, 110

Point = tuple[float, float]
Paths = Mapping[tuple[str, int], Sequence[Cell]]


def map_svg(scenario: Scenario, task: int, paths: Paths) -> Markup:
    """A task's map (landmarks only), and on it the greedy path of each arm that has one."""
    drawn = task_map(scenario, task)
    width, height = drawn.cols * _CELL + 2 * _EDGE, drawn.rows * _CELL + 2 * _EDGE
    parts = [
        Markup('<svg viewBox="0 0 {} {}" class="map" role="img" aria-label="map of task {}">').format(
            width, height, task
        )
    ]
    for row in range(drawn.rows):
        for col in range(drawn.cols):
            cell = row, col
            kind = "obstacle" if cell in drawn.obstacles else "path" if cell in drawn.path else "floor"
            x, y = _EDGE + col * _CELL, _EDGE + row * _CELL
            box = '<rect x="{}" y="{}" width="{}" height="{}" rx="3" class="{}"/>'
            parts.append(Markup(box).format(x + 1, y + 1, _CELL - 2, _CELL - 2, kind))
    walked = [arm for arm in scenario.arm_names if (arm, task) in paths]
    for number, arm in enumerate(walked):
        parts.append(_walk(scenario, arm, paths[arm, task], 4.0 * (number - (len(walked) - 1) / 2)))
    for letter, (row, col) in (("E", drawn.entry), ("X", drawn.exit)):  # in a corner, clear of the walks
        corner = _EDGE + col * _CELL + 7, _EDGE + row * _CELL + 11
        parts.append(Markup('<text x="{}" y="{}">{}</text>').format(*corner, letter))
    return Markup("").join([*parts, Markup("</svg>")])


def _walk(scenario: Scenario, arm: str, cells: Sequence[Cell], aside: float) -> Markup:
    look, name = looks(scenario)[arm], labels(scenario)[arm]
    spots = [(_EDGE + (col + 0.5) * _CELL + aside, _EDGE + (row + 0.5) * _CELL + aside) for row, col in cells]
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y in spots)
    line = (
        '<g data-arm="{}"><title>{}: {} motions</title><polyline points="{}" fill="none" stroke="{}" '
        'stroke-width="2.5" stroke-linejoin="round" stroke-dasharray="{}"/>'
        '<circle cx="{:.1f}" cy="{:.1f}" r="4.5" fill="{}"/></g>'
    )
    return Markup(line).format(arm, name, len(cells) - 1, way, look.colour, dashes(look.line), *spots[-1], look.colour)


def topology_svg(scenario: Scenario) -> Markup:
    """Robots of each cluster in a circle, sidelinks between them; of many clusters the first ones."""
    tasks = list(scenario.clusters)[:_MOST_CLUSTERS]
    across = min(6, len(tasks))
    down = math.ceil(len(tasks) / across)
    head = (
        '<svg viewBox="0 0 {0} {1}" style="max-width: {0}px" class="topology" role="img" '
        'aria-label="clusters and sidelinks">'
    )
    parts = [Markup(head).format(across * _WIDE, down * (_WIDE + 14))]
    for number, task in enumerate(tasks):
        middle = ((number % across + 0.5) * _WIDE, (number // across) * (_WIDE + 14) + _WIDE / 2)
        parts.append(_cluster(scenario, task, middle))
    return Markup("").join([*parts, Markup("</svg>")])


def _cluster(scenario: Scenario, task: int, middle: Point) -> Markup:
    robots = scenario.cluster(task)
    turn = [2 * math.pi * place / len(robots) for place in range(len(robots))]
    spots = {
        robot: (middle[0] + _RADIUS * math.sin(angle), middle[1] - _RADIUS * math.cos(angle))
        for robot, angle in zip(robots, turn, strict=True)
    }
    line = '<line x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}"/>'
    parts = [Markup(line).format(*spots[one], *spots[other]) for one, other in task_graph(scenario, task).edges]
    disc = '<circle cx="{:.1f}" cy="{:.1f}" r="{}"/><text x="{:.1f}" y="{:.1f}">{}</text>'
    parts += [Markup(disc).format(x, y, _ROBOT, x, y + 3.5, robot) for robot, (x, y) in spots.items()]
    parts.append(
        Markup('<text x="{:.1f}" y="{:.1f}" class="name">task {}</text>').format(
            middle[0], middle[1] + _WIDE / 2 + 8, task
        )
    )
    return Markup("").join(parts)
