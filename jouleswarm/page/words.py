"""What the page says, as HTML: the heading, the answer, the arms, what happened. Pure; everything told is escaped."""

from __future__ import annotations

import datetime
import html
from collections.abc import Iterator, Sequence

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.page.model import ArmDone, ArmPriced, Shown
from jouleswarm.report.answer import answer, said
from jouleswarm.report.format import grams_text, joules_text
from jouleswarm.runs.events import Event

_EVENTS = 200
_FIRST = ("why", "turns if")
"""Of an answer's lines; what else it tells is a click away."""
_BY_FORM = "bytes by the closed form of its rounds"


def heading(name: str, shown: Shown | None) -> str:
    """What it is, and how it stands."""
    title = f"<h1>{html.escape(name)}</h1>"
    if shown is None:
        return f'<div class="head">{title}<span class="status starting">starting</span></div>'
    scenario, robots = shown.scenario, len(shown.scenario.agents)
    told = f"scenario {scenario.name}, seed {scenario.seed}: {robots} robots, {len(scenario.clusters)} tasks"
    counted = "" if shown.counted or shown.status == "starting" else f"; {_BY_FORM}"
    status = f'<span class="status {shown.status}">{shown.status}</span>'
    return f'<div class="head">{title}{status}<span class="soft">{_told(shown, told + counted)}</span></div>'


def answer_section(shown: Shown, energy: Energy) -> str:
    """The answer of a run that is over, at these constants; nothing before, and where a price list fails."""
    if not shown.is_over:
        return ""
    run, own = shown.run, shown.scenario.energy
    try:
        found = answer(run, energy)
        told = said(run, energy, found, None if energy == own else answer(run, own))
    except ConfigurationError:  # told with the bill
        return ""
    first, more = ([line for line in told.lines if (line[0] in _FIRST) == wanted] for wanted in (True, False))
    rest = f"<details><summary>more</summary>{_lines(more)}</details>" if more else ""
    changed = f"<p>{html.escape(told.changed)}</p>" if told.changed else ""
    return f'<section class="answer"><b>{html.escape(told.title)}</b>{changed}{_lines(first)}{rest}</section>'


def _lines(told: Sequence[tuple[str, str]]) -> str:
    rows = (f"<dt>{html.escape(what)}</dt><dd>{html.escape(words)}</dd>" for what, words in told)
    return f"<dl>{''.join(rows)}</dl>"


def arm_cards(arms: Sequence[ArmPriced], is_over: bool) -> str:
    """What each arm has cost by now, and how far it has come."""
    return f'<div class="arms">{"".join(_card(arm, is_over) for arm in arms)}</div>'


def events_list(events: Sequence[Event]) -> str:
    """What happened, the newest first."""
    if not events:
        return '<p class="soft">No process has failed, and nothing was refused.</p>'
    return f'<ol class="events">{"".join(_event(each) for each in list(events)[: -_EVENTS - 1 : -1])}</ol>'


def _told(shown: Shown, what: str) -> str:
    return html.escape(f"{what}; {_seconds(shown.seconds)}")


def _card(arm: ArmPriced, is_over: bool) -> str:
    total = "-" if arm.total_j is None else joules_text(arm.total_j)
    number = "" if arm.total_j is None else f' data-joules="{arm.total_j!r}"'
    grams = "" if arm.grams is None else f"; {grams_text(arm.grams)} CO2e"
    name, told = html.escape(arm.done.label), html.escape("; ".join(_progress(arm.done, is_over)) + grams)
    return (
        f'<div class="arm" style="border-color: {arm.done.colour}" data-arm="{html.escape(arm.done.name)}">{name}'
        f'<b{number}>{total}</b><span class="soft">{told}</span></div>'
    )


def _progress(arm: ArmDone, is_over: bool) -> Iterator[str]:
    tasks, learned, rounds = len(arm.learned), sum(arm.learned.values()), sum(arm.rounds.values())
    if arm.t0:
        yield f"{arm.t0} rounds of meta-learning"
    if not rounds and not arm.over:
        yield "its tasks have not begun"
    else:
        yield f"{rounds} rounds of {tasks} tasks"
        going_on = tasks - len(arm.over)
        yield f"{learned} of {tasks} learned" + (f", {going_on} going on" if going_on and not is_over else "")


def _event(event: Event) -> str:
    at = datetime.datetime.fromtimestamp(event.time_s).astimezone().strftime("%H:%M:%S")
    return f"<li><time>{at}</time>{html.escape(event.text)}</li>"


def _seconds(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
