"""The deployment as a drawing: data center, broker and clusters of robots; links as thick as what went over them."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.page.model import Moved
from jouleswarm.report.format import bytes_text

_WIDTH, _CENTRE_Y, _BROKER_Y, _TOP_Y = 480.0, 34.0, 118.0, 196.0
_ROBOT, _GAP, _MARGIN = 11.0, 30.0, 12.0
_THICKEST, _THINNEST = 14.0, 0.8
_MANY = 60
"""Robots are drawn singly up to here; then a circle stands for a cluster."""
_WORDS = {"uplink": "uplink, to the data center", "downlink": "downlink, to robots", "sidelink": "sidelinks"}


class Place(NamedTuple):
    """Where a process stands, in the drawing's own units."""

    x: float
    y: float


class Box(NamedTuple):
    """A cluster's frame."""

    task: int
    x: float
    y: float
    width: float
    height: float


def svg(scenario: Scenario, moved: Sequence[Moved]) -> str:
    """The drawing, as wide as there is room."""
    boxes, places, height = layout(scenario)
    widest = max((each.bytes for each in _hops(moved)), default=0.0)
    parts = [
        *(_line(hop, places, widest) for hop in _hops(moved) if hop.link != "sidelink"),
        *(_arc(hop, places, widest) for hop in _hops(moved) if hop.link == "sidelink"),
        *(_box(box) for box in boxes),
        *_nodes(scenario, places),
        *_legend(moved, height),
    ]
    label = "robots in clusters, the broker and the data center; links as thick as the bytes that went over them"
    view = f'viewBox="0 0 {_WIDTH:g} {height + 62:g}"'
    return f'<svg {view} role="img" aria-label="{label}" class="deployment">{"".join(parts)}</svg>'


def layout(scenario: Scenario) -> tuple[list[Box], dict[str, Place], float]:
    """Frames of the clusters, where each process is, and how high it all is."""
    places = {"datacenter": Place(_WIDTH / 2, _CENTRE_Y), "broker": Place(_WIDTH / 2, _BROKER_Y)}
    clusters, single = scenario.clusters, len(scenario.agents) <= _MANY
    lines = math.ceil(len(clusters) / max(3, math.ceil(math.sqrt(2 * len(clusters)))))
    columns = math.ceil(len(clusters) / lines)
    width = (_WIDTH - _MARGIN * (columns + 1)) / columns
    across = max(1, int((width - 8) // _GAP)) if single else 1
    most = max(len(cluster) for cluster in clusters.values()) if single else 1
    height = 34 + _GAP * math.ceil(most / across)
    boxes = []
    for number, (task, cluster) in enumerate(clusters.items()):
        row, column = divmod(number, columns)
        in_row = min(columns, len(clusters) - row * columns)
        left = (_WIDTH - in_row * width - (in_row - 1) * _MARGIN) / 2
        box = Box(task, left + column * (width + _MARGIN), _TOP_Y + row * (height + _MARGIN), width, height)
        boxes.append(box)
        for place, agent in enumerate(cluster):
            line, at = divmod(place if single else 0, across)
            here = min(across, len(cluster) - line * across) if single else 1
            x = box.x + box.width / 2 + (at - (here - 1) / 2) * _spread(here, box.width)
            places[f"agent-{agent}"] = Place(x, box.y + 18 + _GAP * line)
    return boxes, places, boxes[-1].y + height


def _spread(robots: int, width: float) -> float:
    """Between two robots of a row: wide enough for the arc between a pair to be seen."""
    return min(2.2 * _GAP, width / max(robots, 1))


def _hops(moved: Sequence[Moved]) -> list[Moved]:
    """As it goes over the broker: what one robot sends or gets, and what the data center does."""
    found: dict[tuple[str, str, str], float] = {}
    for each in moved:
        ends = [(each.sender, each.receiver)]
        if each.link != "sidelink":
            ends = [(each.sender, "broker"), ("broker", each.receiver)]
        for end in ends:
            found[each.link, *end] = found.get((each.link, *end), 0.0) + each.bytes
    return [Moved(*key, count) for key, count in found.items()]


def thickness(count: float, widest: float) -> float:
    """Of a link: its area grows with its bytes, so that small ones can still be seen."""
    return _THINNEST + (_THICKEST - _THINNEST) * math.sqrt(count / widest) if count > 0 < widest else 0.0


def _line(hop: Moved, places: Mapping[str, Place], widest: float) -> str:
    one, two = places.get(hop.sender), places.get(hop.receiver)
    if one is None or two is None:
        return ""
    aside = -5.0 if hop.link == "uplink" else 5.0  # both directions between two processes are seen
    ends = f'x1="{one.x + aside:.1f}" y1="{one.y:.1f}" x2="{two.x + aside:.1f}" y2="{two.y:.1f}"'
    return _stroke("line", ends, hop, widest)


def _arc(hop: Moved, places: Mapping[str, Place], widest: float) -> str:
    one, two = places.get(hop.sender), places.get(hop.receiver)
    if one is None or two is None:
        return ""
    bend = 0.35 * (two.x - one.x) if one.y == two.y else 14.0
    x, y = (one.x + two.x) / 2, (one.y + two.y) / 2 + bend
    curve = f'd="M {one.x:.1f} {one.y:.1f} Q {x:.1f} {y:.1f} {two.x:.1f} {two.y:.1f}"'
    return _stroke("path", curve, hop, widest)


def _stroke(tag: str, shape: str, hop: Moved, widest: float) -> str:
    width, told = thickness(hop.bytes, widest), f"{hop.sender} to {hop.receiver}, {hop.link}: {bytes_text(hop.bytes)}"
    inside = f"<title>{html.escape(told)}</title>"
    return f'<{tag} {shape} class="link {hop.link}" fill="none" stroke-width="{width:.2f}">{inside}</{tag}>'


def _box(box: Box) -> str:
    shape = f'x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" height="{box.height:.1f}" rx="8"'
    at = f'x="{box.x + box.width / 2:.1f}" y="{box.y + box.height - 6:.1f}"'
    return f'<rect {shape} class="cluster"/><text {at} class="soft">task {box.task}</text>'


def _nodes(scenario: Scenario, places: Mapping[str, Place]) -> Iterator[str]:
    for name, word in (("datacenter", "data center"), ("broker", "broker")):
        if name == "datacenter" and not scenario.needs_datacenter:
            continue
        at = places[name]
        shape = f'x="{at.x - 52:.1f}" y="{at.y - 17:.1f}" width="104" height="34" rx="6"'
        yield f'<rect {shape} class="node"/><text x="{at.x:.1f}" y="{at.y + 5:.1f}">{word}</text>'
    if len(scenario.agents) > _MANY:
        for cluster in scenario.clusters.values():
            yield _circle(places[f"agent-{cluster[0]}"], f"{len(cluster)}", f"{len(cluster)} robots")
        return
    for agent in scenario.agents:
        yield _circle(places[f"agent-{agent}"], str(agent), f"robot {agent}")


def _circle(at: Place, word: str, told: str) -> str:
    shape = f'cx="{at.x:.1f}" cy="{at.y:.1f}" r="{_ROBOT:g}"'
    text = f'<text x="{at.x:.1f}" y="{at.y + 4.5:.1f}" class="robot">{word}</text>'
    return f'<circle {shape} class="node"><title>{told}</title></circle>{text}'


def _legend(moved: Sequence[Moved], height: float) -> Iterator[str]:
    for number, (link, words) in enumerate(_WORDS.items()):
        total, y = sum(each.bytes for each in moved if each.link == link), height + 20 + 18 * number
        yield f'<line x1="14" y1="{y - 4:.1f}" x2="40" y2="{y - 4:.1f}" class="link {link}" stroke-width="5"/>'
        yield f'<text x="48" y="{y:.1f}" class="left">{words}: <tspan class="strong">{bytes_text(total)}</tspan></text>'
