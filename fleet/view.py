"""The live view of a run: where every cluster stands, and what it has cost so far."""

from __future__ import annotations

import time

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from common.energy import BITS_PER_BYTE
from common.runlog import RoundRow
from common.scenario import Scenario
from fleet.recorder import Recorder

_LINE_EVERY_S = 10.0
ARM_NAMES = {"maml": "with MAML", "fl": "without MAML"}


class View:
    """Context manager; call `update` now and then. On a pipe it prints a line every few seconds instead."""

    def __init__(self, console: Console, scenario: Scenario, recorder: Recorder) -> None:
        self._console, self._scenario, self._recorder = console, scenario, recorder
        self._live = Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal else None
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
        meta = self._meta_round()
        parts = [f"{self._recorder.elapsed_s:5.0f} s", f"MAML {meta}/{self._scenario.meta.t0}"]
        for arm in self._scenario.arm_names:
            rounds = {task: self._cluster(arm, task) for task in self._scenario.clusters}
            told = [f"{task}:{_short(row)}" for task, row in rounds.items() if row]
            if told:
                parts.append(f"{arm} " + " ".join(told))
        moved = self._recorder.received_bytes
        parts.append(" ".join(f"{link} {count / 1e6:.1f} MB" for link, count in moved.items() if count))
        return " | ".join(parts)

    def render(self) -> RenderableType:
        """The whole view."""
        title = Text(f"{self._scenario.name}, seed {self._scenario.seed}: {self._recorder.elapsed_s:.0f} s")
        return Group(title, self._stages(), self._links())

    def _stages(self) -> Table:
        table = Table("phase", "task", "round", "R", "", box=None, pad_edge=False)
        if self._scenario.meta_methods:
            done, t0 = self._meta_round(), self._scenario.meta.t0
            table.add_row("MAML", "all", f"{done}/{t0}", "", ProgressBar(total=t0, completed=done, width=30))
        target = self._scenario.federation.target_reward
        for arm in self._scenario.arm_names:
            for task in self._scenario.clusters:
                row = self._cluster(arm, task)
                if row is None:
                    continue
                reward = row.cluster_reward
                state: RenderableType = ProgressBar(total=target, completed=max(0.0, reward or 0.0), width=30)
                if row.learned is not None:
                    state = Text("learned", "green") if row.learned else Text("not learned", "red")
                shown = "" if reward is None else f"{reward:.1f}"
                table.add_row(f"FL {ARM_NAMES[arm]}", str(task), str(row.round), shown, state)
        return table

    def _links(self) -> Table:
        energy = self._scenario.energy
        bit_per_j = {
            "uplink": energy.ul_bit_per_j,
            "downlink": energy.dl_bit_per_j or energy.ul_bit_per_j,
            "sidelink": energy.sl_bit_per_j,
        }
        table = Table("received over", "MB", "J so far", box=None, pad_edge=False)
        for link, count in self._recorder.received_bytes.items():
            joules = f"{count * BITS_PER_BYTE / bit_per_j[link]:,.0f}" if link in bit_per_j else "not priced"
            table.add_row(link, f"{count / 1e6:,.1f}", joules)
        return table

    def _meta_round(self) -> int:
        return max((row.round for (_, _, agent), row in self._recorder.newest.items() if agent == 0), default=0)

    def _cluster(self, arm: str, task: int) -> RoundRow | None:
        rows = [self._recorder.newest.get((arm, task, agent)) for agent in self._scenario.cluster(task)]
        begun = [row for row in rows if row is not None and row.phase == "fl"]
        return min(begun, key=lambda row: row.round, default=None)


def _short(row: RoundRow) -> str:
    done = {None: "", True: "+", False: "-"}[row.learned]
    return f"{row.round}{done}" + ("" if row.cluster_reward is None else f"({row.cluster_reward:.0f})")
