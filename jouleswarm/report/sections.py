"""The live view on a terminal: sections, of which as many are shown as its height has room for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from rich.console import Console, Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.bill import Bill, causes_of
from jouleswarm.report.answer import short_labels
from jouleswarm.report.arms import labels
from jouleswarm.report.format import bytes_text, joules_text
from jouleswarm.report.pace import duration_text
from jouleswarm.report.standing import Cluster, Live, clusters, is_over, phase, rounds_of, stage_round, waits

_SIDE_BY_SIDE = 2  # arms that are columns
_BAR = 24
_WAITS_SHOWN = 2
_AT_THE_END = "at the end"


@dataclass(frozen=True)
class Standing:
    """What is shown of a run at one moment."""

    scenario: Scenario
    heard: Live
    left: str
    """Time left, in words."""
    bills: Mapping[str, Bill | None]
    """Arm -> so far; None: known at the end only."""
    whole: Bill | None
    """All arms together."""
    others: Mapping[str, Bill | None]
    """Label of another price list -> all arms together by it."""
    first: Mapping[tuple[str, int], float | None]
    """(arm, task) -> R when it was first heard of."""
    since: str
    """`so far`, or since when the joules are counted."""


class Section(NamedTuple):
    """A part of the view."""

    rank: int
    """Shown first where there is little room: the lowest."""
    shown: RenderableType


def screen(standing: Standing, console: Console, height: int) -> RenderableType:
    """The sections that fit into so many lines, in their order."""
    room, chosen, sections = height, set(), list(_sections(standing))
    options = console.options.update(height=None)
    for place, section in sorted(enumerate(sections), key=lambda each: each[1].rank):
        lines = len(console.render_lines(section.shown, options, pad=False))
        if lines <= room:
            room -= lines
            chosen.add(place)
    return Group(*(section.shown for place, section in enumerate(sections) if place in chosen))


def _sections(standing: Standing) -> Iterator[Section]:
    scenario, heard = standing.scenario, standing.heard
    title = Text(f"{scenario.name}, seed {scenario.seed}: {duration_text(heard.elapsed_s)}", "bold")
    yield Section(0, title.append(f"; {standing.left}", "not bold"))
    yield Section(1, Text(phase(scenario, heard), "cyan"))
    if lasting := waits(scenario, heard):
        yield Section(2, Text("\n".join(lasting[:_WAITS_SHOWN]), "yellow"))
        if more := lasting[_WAITS_SHOWN:]:
            yield Section(9, Text("\n".join(more), "yellow"))
    yield Section(5, _arms(standing))
    if any(clusters(scenario, heard, arm.name) for arm in scenario.arms):
        yield Section(3, _clusters(standing))
    if standing.whole is None:
        yield Section(4, Text(f"joules: {_AT_THE_END}"))
    elif heard.spent.counts:
        yield Section(4, _joules(standing, standing.whole))
    if any(heard.received_bytes.values()):
        yield Section(6, _links(standing))
    if any(agent for _, _, agent in heard.newest):
        yield Section(7, _robots(standing))


def _table(*headings: str) -> Table:
    """The first column holds names, which may be broken; figures keep their unit."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="right" if place else "left", no_wrap=False, overflow="fold")
    return table


def _arms(standing: Standing) -> Table:
    """A line an arm: how far it is."""
    scenario, heard = standing.scenario, standing.heard
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("arm")
    table.add_column("where it stands")
    for arm in scenario.arms:
        known = clusters(scenario, heard, arm.name)
        done = stage_round(heard, arm.method)
        learned = sum(bool(each.learned) for each in known)
        style = ""
        if is_over(scenario, heard, arm.name):
            what = f"{learned} of {len(known)} learned, {rounds_of(scenario, heard, arm.name)} rounds"
            style = "green" if learned == len(known) else "red"
        elif known:
            first, last = min(each.round for each in known), max(each.round for each in known)
            what = f"{learned} of {len(scenario.clusters)} learned, round {first}" + (
                f" to {last}" if last > first else ""
            )
        elif arm.t0 and done:
            what = f"{done} of {scenario.meta.t0} rounds in the data center"
        else:
            what = "to come"
        table.add_row(labels(scenario)[arm.name], Text(what, style))
    return table


def _clusters(standing: Standing) -> Table:
    """A line a task: R towards the target, in the arm that its cluster is in."""
    scenario, target = standing.scenario, standing.scenario.federation.target_reward
    table = Table(box=None, pad_edge=False, header_style="dim", expand=True)
    for heading in ("task", "arm", "round", "R"):
        table.add_column(heading, justify="left" if heading == "arm" else "right")
    table.add_column(f"from R at first to {target:g}", ratio=1)
    found: dict[int, tuple[str, Cluster]] = {}
    for arm in scenario.arms:
        found |= {each.task: (arm.name, each) for each in clusters(scenario, standing.heard, arm.name)}
    names = short_labels(scenario)
    for task, (name, each) in sorted(found.items()):
        reward = "" if each.reward is None else f"{each.reward:.1f}"
        table.add_row(
            str(task), names[name], str(each.round), reward, _progress(each, standing.first.get((name, task)), target)
        )
    return table


def _progress(cluster: Cluster, first: float | None, target: float) -> RenderableType:
    """How much of the way from where R began to its target is done."""
    if cluster.learned is not None:
        return Text("learned", "green") if cluster.learned else Text("not learned", "red")
    return ProgressBar(total=1.0, completed=share_of_way(first, cluster.reward, target), width=_BAR)


def share_of_way(first: float | None, reward: float | None, target: float) -> float:
    """0 to 1; 0 where nothing is known, or R is no higher than at first."""
    if first is None or reward is None or reward <= first:
        return 0.0
    return 1.0 if reward >= target else (reward - first) / (target - first)


def _joules(standing: Standing, whole: Bill) -> Table:
    """Joules by cause, of each arm where there are few, and in total."""
    scenario, names = standing.scenario, short_labels(standing.scenario)
    bills = [bill for bill in standing.bills.values() if bill is not None]
    arms = names if 1 < len(bills) <= _SIDE_BY_SIDE and len(bills) == len(scenario.arms) else {}
    table = _table(f"joules {standing.since}", *(names[arm] for arm in arms), "in total")
    columns = [*(bill for bill in bills if arms), whole]
    for cause in causes_of([whole.both]):
        if whole.both.by_cause[cause]:
            table.add_row(cause.label, *(joules_text(bill.both.by_cause[cause]) for bill in columns))
    table.add_row("energy", *(joules_text(bill.total_j) for bill in columns), style="bold")
    for label, other in standing.others.items():
        blank = [""] * (len(columns) - 1)
        table.add_row(f"energy by {label}", *blank, _AT_THE_END if other is None else joules_text(other.total_j))
    return table


def _links(standing: Standing) -> Text:
    received = standing.heard.received_bytes.items()
    moved = ", ".join(f"{link} {bytes_text(count)}" for link, count in received if link != Link.CONTROL)
    return Text(f"received: {moved}", "dim")


def _robots(standing: Standing) -> Table:
    """A line a process: its newest round; only where there is much room."""
    names = short_labels(standing.scenario)
    table = _table("robot", "task", "arm", "round", "its own reward", "gradients", "the round took")
    newest = {}
    for (arm, task, agent), row in standing.heard.newest.items():
        if agent:
            newest[agent] = (names.get(arm, arm), task, row)
    for agent, (name, task, row) in sorted(newest.items()):
        what = f"{name}, data center's" if row.phase == RowPhase.ML else name
        own = "" if row.reward is None else f"{row.reward:.1f}"
        table.add_row(str(agent), str(task), what, str(row.round), own, str(row.gradients), f"{row.seconds:.2f} s")
    return table
