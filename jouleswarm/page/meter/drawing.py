"""Clients around the broker as a drawing; links as thick as what went over them. Pure; what others named is escaped."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Mapping, Sequence

from jouleswarm.page.drawing import Place, thickness
from jouleswarm.page.meter.model import Client, MeterShown, Passed
from jouleswarm.report.format import bytes_text

_WIDTH, _ACROSS, _DOWN = 640.0, 172.0, 122.0
_CENTRE = Place(_WIDTH / 2, 172.0)
_LEGEND_Y = 352.0
_CLIENT, _GAP = 15.0, 1.5
_LETTERS = 12


def meter_svg(shown: MeterShown) -> str:
    """The drawing, as wide as there is room."""
    places = around(len(shown.clients))
    widest = max((each for client in shown.clients for _, _, each in _ways(client)), default=0)
    parts = [
        *(line for client, at in zip(shown.clients, places, strict=True) for line in _lines(client, at, widest, shown)),
        *(_circle(client, at) for client, at in zip(shown.clients, places, strict=True)),
        *_hub(shown.hub),
        *_legend(shown.links),
    ]
    label = f"clients around the {shown.hub}; links as thick as the bytes that went over them"
    view = f'viewBox="0 0 {_WIDTH:g} {_LEGEND_Y + 20 * len(shown.links):g}"'
    return f'<svg {view} role="img" aria-label="{label}" class="deployment meter">{"".join(parts)}</svg>'


def around(count: int) -> list[Place]:
    """Where so many clients stand: evenly, the first at the top."""
    angles = (2 * math.pi * number / count - math.pi / 2 for number in range(count))
    return [Place(_CENTRE.x + _ACROSS * math.cos(each), _CENTRE.y + _DOWN * math.sin(each)) for each in angles]


def short(name: str, letters: int = _LETTERS) -> str:
    """So that it fits: both ends of it."""
    head = (letters - 1) // 2
    return name if len(name) <= letters else f"{name[:head]}…{name[head + 1 - letters :]}"


def _ways(client: Client) -> Iterator[tuple[str, str, int]]:
    """(link, sent or got, bytes) of what went over."""
    for link, passed in client.by_link.items():
        for way, count in (("sent", passed.sent_bytes), ("got", passed.got_bytes)):
            if count:
                yield link, way, count


def _lines(client: Client, at: Place, widest: int, shown: MeterShown) -> Iterator[str]:
    """Side by side, from the client to the middle."""
    ways = [(*each, thickness(each[2], widest)) for each in _ways(client)]
    length = math.dist(at, _CENTRE)
    across = Place((_CENTRE.y - at.y) / length, (at.x - _CENTRE.x) / length)
    aside = -sum(width + _GAP for *_, width in ways) / 2
    for link, way, count, width in ways:
        middle = aside + (width + _GAP) / 2
        aside += width + _GAP
        x, y = middle * across.x, middle * across.y
        ends = f'x1="{at.x + x:.1f}" y1="{at.y + y:.1f}" x2="{_CENTRE.x + x:.1f}" y2="{_CENTRE.y + y:.1f}"'
        one, two = (client.name, shown.hub) if way == "sent" else (shown.hub, client.name)
        told = html.escape(f"{one} to {two}, {link}: {bytes_text(count)}")
        yield f'<line {ends} class="link {link}" stroke-width="{width:.2f}"><title>{told}</title></line>'


def _circle(client: Client, at: Place) -> str:
    """With its name outside of it."""
    aside = (at.x - _CENTRE.x) / _ACROSS
    if abs(aside) < 0.1:
        x, y, anchor = at.x, at.y + (-21 if at.y < _CENTRE.y else 30), "middle"
    else:
        x, y, anchor = at.x + math.copysign(20, aside), at.y + 5, "start" if aside > 0 else "end"
    shape = f'cx="{at.x:.1f}" cy="{at.y:.1f}" r="{_CLIENT:g}"'
    told, name = html.escape(_told(client)), html.escape(short(client.name))
    text = f'<text x="{x:.1f}" y="{y:.1f}" style="text-anchor: {anchor}">{name}</text>'
    return f'<g class="client"><circle {shape} class="node"/>{text}<title>{told}</title></g>'


def _told(client: Client) -> str:
    sent, got = (sum(count for _, way, count in _ways(client) if way == wanted) for wanted in ("sent", "got"))
    return f"{client.name}: {bytes_text(sent)} sent, {bytes_text(got)} got"


def _hub(word: str) -> Sequence[str]:
    x, y = _CENTRE
    shape = f'x="{x - 46:g}" y="{y - 17:g}" width="92" height="34" rx="6"'
    return f'<rect {shape} class="node"/>', f'<text x="{x:g}" y="{y + 5:g}">{word}</text>'


def _legend(links: Mapping[str, Passed]) -> Iterator[str]:
    for number, (link, passed) in enumerate(links.items()):
        y = _LEGEND_Y + 20 * number
        yield f'<line x1="14" y1="{y - 4:g}" x2="40" y2="{y - 4:g}" class="link {link}" stroke-width="5"/>'
        told = f"{bytes_text(passed.sent_bytes)} sent, {bytes_text(passed.got_bytes)} got"
        yield f'<text x="48" y="{y:g}" class="left">{link}: <tspan class="strong">{told}</tspan></text>'
