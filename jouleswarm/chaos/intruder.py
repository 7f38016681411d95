"""Who does harm to a run on purpose: one fault of a plan after the other, each in its phase."""

from __future__ import annotations

import contextlib
import math
import random
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from jouleswarm.chaos.faults import TWINS, Site, inject, refused
from jouleswarm.chaos.plan import FAILED, Fault
from jouleswarm.chaos.proxy import Proxy
from jouleswarm.chaos.ramdisk import RamDisk
from jouleswarm.chaos.scenes import ENDED_BY_AN_ERROR, INTERRUPTED
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import ROOT
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.fleet.launcher import Launcher
from jouleswarm.fleet.recorder import Recorder

PHASE_OF = {RowPhase.ML: "meta-learning", RowPhase.FL: "federated"}

# At most, from the beginning of a phase or the last recovery to the next fault. Of what a phase has left of its rows
# half pass at most, so that a fast machine is not through with it before the fault.
_DELAY_S = {"starting": 0.5, "meta-learning": 1.0, "federated": 2.0, "leaving": 0.1}
_SHARE_OF_ROWS = 0.5
_TICK_S, _BRIEF_TICK_S = 0.2, 0.01
_LATE = 0.25  # so much of the rows is left from where processes may leave at any moment


@dataclass(frozen=True)
class Due:
    """When the next fault is due: at a time, or with a row, whichever comes first."""

    phase: str
    at_s: float
    rows: float


@dataclass
class Chaos:
    """An intruder (`fleet.deploy.Intruder`) who injects the faults of a plan, one after the other."""

    scenario: Scenario
    options: list[str]
    path: Path
    """The run directory."""
    plan: list[Fault]
    pause_s: float
    rng: random.Random
    rows_in: dict[str, int]
    """Rows of each phase of the undisturbed run."""
    disk: RamDisk | None = None
    """What the run directory is on, if on a disk of its own."""
    idle: int = 0
    """How many runs before this one were over before any fault."""
    done: list[Fault] = field(default_factory=list)
    ending: Fault | None = None
    """The fault that is to end the run, which is gone on with then."""
    _open: Fault | None = None
    _opened_s: float = 0.0
    _before: int = 0
    """Rows at the open fault's injection, as `_count` counts them."""
    _due: Due | None = None
    _rows: list[RoundRow] = field(default_factory=list)
    """As they were at the beginning of this tick: the recorder reads them from its file."""

    @property
    def tick_s(self) -> float:
        """Starting and leaving take a moment only, which must not be missed."""
        is_brief = not self._rows or self._left <= _LATE * sum(self.rows_in.values())
        return _BRIEF_TICK_S if is_brief else _TICK_S

    @property
    def _left(self) -> int:
        """Rows that are to come."""
        return sum(self.rows_in.values()) - len(self._rows)

    @property
    def run(self) -> str:
        """The run's name."""
        return self.path.name

    @contextlib.contextmanager
    def line(self, url: str, launcher: Launcher, recorder: Recorder) -> Iterator[str]:
        """The processes talk to the broker by a proxy that can be told to spoil their connections."""
        eye = _onlooker(url, self.run, self.scenario.bus.connect_timeout_s)
        with Proxy(url, self.rng.randrange(2**31)) as proxy:
            self._recorder = recorder
            self._site = Site(
                *(self.scenario, launcher, proxy, url, self.run, self.options, self.pause_s, self.rng, eye, self.path),
                disk=self.disk,
            )
            try:
                yield proxy.url
                self._end()
            finally:
                self._site.end()
                eye.close()

    def tick(self) -> None:
        """Inject a fault of the phase that the run is in, and see whether the last one has been got over."""
        self._rows = self._recorder.rows
        self._site.here = tuple(self._recorder.waiting_for)
        self._site.told = tuple(sorted({row.agent for row in self._rows if row.agent}))
        self._site.tick()
        now_s, phase = time.monotonic(), self.phase
        if self._open is not None:
            self._look_at(self._open)
            return
        fault = next((each for each in self.plan if each.phase == phase), None)
        if fault is None:
            self._due = None
            return
        if self._due is None or self._due.phase != phase:
            self._due = self._draw(phase, now_s)
        if now_s >= self._due.at_s or self._rows_of(phase) >= self._due.rows:
            self._inject(fault)

    def _inject(self, fault: Fault) -> None:
        target = inject(fault.kind, self._site)
        if target is None:
            return
        self.plan.remove(fault)
        self.done.append(fault)
        fault.target, fault.run, fault.at_s = target, self.run, self._recorder.elapsed_s
        self._open, self._opened_s, self._before, self._due = fault, time.monotonic(), self._count(fault), None
        if fault.kind in (*INTERRUPTED, *ENDED_BY_AN_ERROR):
            self.ending = fault
        if fault.kind in INTERRUPTED:
            raise KeyboardInterrupt

    @property
    def phase(self) -> str:
        """Where the run is, by its newest row, and by how far robots say that they have come."""
        if not self._rows:
            return "starting"
        come = min(self._recorder.stages.get(f"agent-{agent}", 0) for agent in self.scenario.agents)
        is_last = come >= 2 * len(self.scenario.arms) or self._left <= len(self.scenario.agents)
        return "leaving" if is_last else PHASE_OF[self._rows[-1].phase]

    def _rows_of(self, phase: str) -> int:
        return sum(PHASE_OF[row.phase] == phase for row in self._rows)

    def _draw(self, phase: str, now_s: float) -> Due:
        so_far = self._rows_of(phase)
        left = self.rows_in.get(phase, 0) - so_far
        rows = so_far + self.rng.uniform(0, _SHARE_OF_ROWS) * left if left > 0 else math.inf
        return Due(phase, now_s + self.rng.uniform(0, _DELAY_S[phase] / 4**self.idle), rows)

    def _look_at(self, fault: Fault) -> None:
        if self.ending is not None:
            return
        if fault.kind in TWINS:
            answer = refused(self._site.twins[-1])
            if answer is None:
                return
            fault.note = "refused" if answer else f"{FAILED}refused"
        elif (fault.kind in ("weights cut", "frame cut") and self._site.proxy.is_armed) or self._site.later:
            return
        elif self._is_leaving(fault):
            self._open = None  # there is nothing more to come from it
            return
        elif self._count(fault) <= self._before:
            return
        self._close(fault)

    def _is_leaving(self, fault: Fault) -> bool:
        return fault.target in self._site.launcher.pids and fault.target not in ("broker", *self._recorder.waiting_for)

    def _close(self, fault: Fault) -> None:
        fault.recovery_s, self._open = time.monotonic() - self._opened_s, None

    def _end(self) -> None:
        """The run has come to its end: so has what was done to it as it was leaving."""
        fault = self._open
        if fault is None:
            return
        if fault.kind == "same run twice":
            fault.note = "refused" if refused(self._site.twins[-1], wait=True) else f"{FAILED}refused"
        elif fault.kind in TWINS:
            fault.note = "has left before"
        if fault.kind in ENDED_BY_AN_ERROR and self.ending is fault:
            fault.note = "had no more to write" if self.disk is None else f"{FAILED}noticed"
        if fault.phase == "leaving":
            self._close(fault)

    def _count(self, fault: Fault) -> int:
        """Rows so far of whom the fault was done to."""
        if fault.target.startswith("agent-"):
            return sum(f"agent-{row.agent}" == fault.target for row in self._rows)
        return sum(row.agent == 0 for row in self._rows) if fault.target == "datacenter" else len(self._rows)


def _onlooker(url: str, run: str, connect_timeout_s: float) -> MqttBus:
    """A client that hears what can be duplicated."""
    bus = MqttBus.connect(url, "onlooker", connect_timeout_s=connect_timeout_s)
    bus.subscribe(f"{ROOT}/{run}/+/sl/#", f"{ROOT}/{run}/+/ul/#", f"{ROOT}/{run}/+/dl/#")
    return bus
