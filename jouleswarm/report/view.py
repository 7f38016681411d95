"""The live view of a run: where every cluster stands, and what it has cost so far."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Protocol

from rich import live
from rich.console import Console, Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.facts import STAGE, Counts, Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, own_lists, price, price_lists
from jouleswarm.report.arms import label, method_label

_LINE_EVERY_S = 10.0
_WAITS_SHOWN = 3


class Live(Protocol):
    """What is known of a run while it goes on; the recorder knows."""

    @property
    def elapsed_s(self) -> float:
        """Since the run began, seconds."""

    @property
    def newest(self) -> Mapping[tuple[str, int, int], RoundRow]:
        """(arm, task, agent) -> its newest row."""

    @property
    def received_bytes(self) -> Mapping[str, int]:
        """Link class -> payload bytes that have been received."""

    @property
    def waits(self) -> Sequence[str]:
        """What lasts, the longest first, a line each."""


class View:
    """Context manager; call `update` now and then. On a pipe it prints a line every few seconds instead."""

    def __init__(self, console: Console, scenario: Scenario, recorder: Live) -> None:
        self._console, self._scenario, self._recorder = console, scenario, recorder
        lists = price_lists(scenario)
        self._lists = [*([literal] if literal in lists else []), *own_lists(lists)]
        self._live = live.Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal else None
        self._line_at = time.monotonic()

    def __enter__(self) -> View:
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def update(self) -> None:
        """Show the newest state."""
        if self._live:
            self._live.update(self.render())
        elif time.monotonic() - self._line_at >= _LINE_EVERY_S:
            self._line_at = time.monotonic()
            self._console.print(self.line(), highlight=False)

    def line(self) -> str:
        """One line for logs."""
        parts = [f"{self._recorder.elapsed_s:5.0f} s"]
        for method in self._scenario.meta_methods:
            parts.append(f"{method_label(self._scenario, method)} {self._meta_round(method)}/{self._scenario.meta.t0}")
        for arm in self._scenario.arm_names:
            rounds = {task: self._cluster(arm, task) for task in self._scenario.clusters}
            told = [f"{task}:{_short(row)}" for task, row in rounds.items() if row]
            if told:
                parts.append(f"{arm} done" if self._is_over(arm) else f"{arm} " + " ".join(told))
        moved = self._recorder.received_bytes
        parts.append(" ".join(f"{link} {count / 1e6:.1f} MB" for link, count in moved.items() if count))
        return " | ".join([*parts, *self._waits()])

    def render(self) -> RenderableType:
        """The whole view."""
        title = Text(f"{self._scenario.name}, seed {self._scenario.seed}: {self._recorder.elapsed_s:.0f} s")
        return Group(title, self._stages(), self._links(), *(Text(wait, "yellow") for wait in self._waits()))

    def _waits(self) -> list[str]:
        """What lasts, the longest first."""
        waits = self._recorder.waits
        more = len(waits) - _WAITS_SHOWN
        return [*waits[:_WAITS_SHOWN], *([f"and {more} more wait"] if more > 0 else [])]

    def _stages(self) -> Table:
        table = Table("phase", "task", "round", "R", "", box=None, pad_edge=False)
        t0 = self._scenario.meta.t0
        for method in self._scenario.meta_methods:
            done = self._meta_round(method)
            bar = ProgressBar(total=t0, completed=done, width=30)
            table.add_row(f"data center: {method_label(self._scenario, method)}", "all", f"{done}/{t0}", "", bar)
        for arm in self._scenario.arms:
            if self._is_over(arm.name):
                self._add_result(table, arm)
            else:
                self._add_clusters(table, arm)
        return table

    def _add_clusters(self, table: Table, arm: Arm) -> None:
        target = self._scenario.federation.target_reward
        for task in self._scenario.clusters:
            row = self._cluster(arm.name, task)
            if row is None:
                continue
            reward = row.cluster_reward
            state: RenderableType = ProgressBar(total=target, completed=max(0.0, reward or 0.0), width=30)
            if row.learned is not None:
                state = Text("learned", "green") if row.learned else Text("not learned", "red")
            shown = "" if reward is None else f"{reward:.1f}"
            table.add_row(label(self._scenario, arm), str(task), str(row.round), shown, state)

    def _add_result(self, table: Table, arm: Arm) -> None:
        """One row for all tasks of an arm that is over, so that many arms fit a screen."""
        ends = [self._rows(arm.name, task) for task in self._scenario.clusters]
        rounds = sum(max(row.round for row in rows) for rows in ends)
        learned = sum(all(row.learned for row in rows) for rows in ends)
        text = Text(f"{learned} of {len(ends)} learned", "green" if learned == len(ends) else "red")
        table.add_row(label(self._scenario, arm), "all", f"sum {rounds}", "", text)

    def _links(self) -> Table:
        headings = ["J so far" if each is literal else f"J so far, {each.label}" for each in self._lists]
        table = Table("received over", "MB", *headings, box=None, pad_edge=False)
        for link, count in self._recorder.received_bytes.items():
            joules = (self._joules_text(each, Link(link), count) for each in self._lists)
            table.add_row(link, f"{count / 1e6:,.1f}", *joules)
        return table

    def _joules_text(self, prices: PriceList, link: Link, count: int) -> str:
        energy = self._scenario.energy
        if link == Link.CONTROL:
            return "not priced"
        if link == Link.SIDELINK and energy.sidelink != "direct":  # they also depend on what is sent
            return "at the end"
        counts = Counts(**{f"{link}_bytes": count})
        try:
            bill = price(prices, Facts("", "", t0=0, parts={("fl", STAGE): counts}), energy)
        except ConfigurationError:  # told with the bill; a view never ends a run
            bill = None
        return "at the end" if bill is None else f"{bill.total_j:,.0f}"

    def _meta_round(self, method: str) -> int:
        newest = self._recorder.newest.items()
        rounds = (row.round for (arm, _, agent), row in newest if (arm, agent, row.phase) == (method, 0, RowPhase.ML))
        return max(rounds, default=0)

    def _rows(self, arm: str, task: int) -> list[RoundRow]:
        """The newest row of each robot of a cluster that has begun to learn."""
        rows = (self._recorder.newest.get((arm, task, agent)) for agent in self._scenario.cluster(task))
        return [row for row in rows if row is not None and row.phase == RowPhase.FL]

    def _is_over(self, arm: str) -> bool:
        return all(
            len(rows) == len(cluster) and all(row.learned is not None for row in rows)
            for task, cluster in self._scenario.clusters.items()
            for rows in [self._rows(arm, task)]
        )

    def _cluster(self, arm: str, task: int) -> RoundRow | None:
        """Where a cluster stands: at its slowest robot; one that is done does not hide one that is not."""
        return min(
            self._rows(arm, task),
            key=lambda row: (row.learned is not None, bool(row.learned), row.round),
            default=None,
        )


def _short(row: RoundRow) -> str:
    done = {None: "", True: "+", False: "-"}[row.learned]
    return f"{row.round}{done}" + ("" if row.cluster_reward is None else f"({row.cluster_reward:.0f})")
