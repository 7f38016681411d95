"""What the page of a meter says, as HTML. Pure; everything that clients and rules named is escaped."""

from __future__ import annotations

import datetime
import html
from collections.abc import Iterable, Iterator

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.page.meter.model import Busy, MeterPriced, MeterShown
from jouleswarm.report.format import bytes_text, joules_text

_HEADINGS = ("client", "link", "joules", "payload", "messages", "topics")
_FIGURES = _HEADINGS[2:5]
_WAYS = {"in": "from", "out": "to"}


def meter_heading(name: str, shown: MeterShown | None) -> str:
    """What it is, and how it stands."""
    title = f"<h1>{html.escape(name)}</h1>"
    if shown is None:
        return f'<div class="head">{title}</div>'
    status = f'<span class="status {shown.status}">{shown.status}</span>'
    began = datetime.datetime.fromisoformat(str(shown.metered.manifest["started"]))
    clients = f"{shown.number} client{'s' * (shown.number != 1)}"
    told = f"metered since {began.astimezone(datetime.UTC):%Y-%m-%d %H:%M} UTC; {clients}"
    return f'<div class="head">{title}{status}<span class="soft">{told}</span></div>'


def total_section(shown: MeterShown, priced: MeterPriced) -> str:
    """Joules and bytes, and by which prices."""
    number = "" if priced.total_j is None else f' data-joules="{priced.total_j!r}"'
    sent, got = (sum(getattr(each, way) for each in shown.links.values()) for way in ("sent_bytes", "got_bytes"))
    packets = sum(row.packet_bytes for row in shown.metered.rows)
    nothing = "" if shown.facts else " Nothing passed that a rule prices."
    lines = (
        ("payload", f"{bytes_text(sent)} sent by clients, {bytes_text(got)} got by them; {bytes_text(packets)} in all "
                  f"packets."),
        ("prices", f"{shown.prices.label}: {_constants(priced.energy)}.{nothing}"),
    )  # fmt: skip
    rows = "".join(f"<dt>{what}</dt><dd>{html.escape(words)}</dd>" for what, words in lines)
    return (
        f'<section class="answer"><b class="total"{number}>{joules_text(priced.total_j)}</b><dl>{rows}</dl></section>'
    )


def busiest_table(busiest: Iterable[tuple[Busy, float | None]]) -> str:
    """Who moves most on which topics; what is too long for a line is whole below the pointer."""
    head = "".join(f'<th class="{"figure" * (heading in _FIGURES)}">{heading}</th>' for heading in _HEADINGS)
    lines = "".join(f"<tr>{''.join(_cells(busy, joules))}</tr>" for busy, joules in busiest)
    return f'<div class="table"><table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div>'


def notes_text(notes: Iterable[str]) -> str:
    """What is no message of any rule, and rules that nothing came to."""
    told = "".join(f'<p class="soft">{html.escape(note)}</p>' for note in notes)
    return f'<div class="wide">{told}</div>'


def _constants(energy: Energy) -> str:
    downlink = energy.ul_bit_per_j if energy.dl_bit_per_j is None else energy.dl_bit_per_j
    each = (("uplink", energy.ul_bit_per_j), ("downlink", downlink), ("sidelink", energy.sl_bit_per_j))
    return ", ".join(f"{link} {bit_per_j / 1e3:.4g} kb/J" for link, bit_per_j in each)


def _cells(busy: Busy, joules: float | None) -> Iterator[str]:
    yield _name(f"{_WAYS[busy.direction]} {busy.client}")
    yield _name(busy.link)
    for figure in (joules_text(joules), bytes_text(busy.passed.bytes), str(busy.messages)):
        yield f'<td class="figure">{figure}</td>'
    yield _name(busy.topics)


def _name(told: str) -> str:
    return f'<td title="{html.escape(told)}">{html.escape(told)}</td>'
