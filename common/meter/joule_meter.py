"""Books what a process draws to what it does at the moment; importing it loads no library."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from jouleswarm.common.meter.cells import Cell, Key
from jouleswarm.common.meter.power import Nvml, Processor

JOULES = "joules"
"""In place of a direction: a cell of nanoseconds, nanojoules and nanoseconds of CPU time, not of bytes."""
Clock = Callable[[], int]
"""Nanoseconds."""
_SETTLE_NS = 250_000_000  # counters are read so often at most: they are not finer than some 10 ms, and reading costs
_N = 1_000_000_000


class JouleMeter:
    """Books joules and seconds to what the process does at the moment; without a `processor` it does nothing.

    Joules are read when an activity ends, a quarter of a second after the last time at the earliest, and shared out
    over what was done meanwhile: the processor's by CPU time, the GPU's by seconds. One thread.
    """

    def __init__(
        self,
        cell: Callable[[Key], Cell] | None = None,
        processor: Processor | None = None,
        gpu: Nvml | None = None,
        clocks: tuple[Clock, Clock] = (time.monotonic_ns, time.process_time_ns),
    ) -> None:
        """`cell`: where a key is counted; `clocks`: of the wall, and of the process's CPU time."""
        self._cell, self._processor, self._gpu, self._clocks = cell, processor, gpu, clocks
        self._place, self._activity = "/", "start"
        self._then = [clock() for clock in clocks]
        self._settled = self._then[0]
        self._open: dict[str, list[int]] = defaultdict(lambda: [0, 0])  # since then: nanoseconds, of wall and CPU

    def enter(self, phase: str, arm: str, activity: str = "communication") -> None:
        """From here on the process works for an arm's phase, and does this where nothing else is said."""
        self._go(f"{phase}/{arm}", activity)

    @contextmanager
    def during(self, activity: str) -> Iterator[None]:
        """What is done inside is that."""
        before = self._activity
        self._go(self._place, activity)
        try:
            yield
        finally:
            self._go(self._place, before)

    def settle(self) -> None:
        """Book all until now."""
        if self._processor is not None:
            self._settled -= _SETTLE_NS
            self._go(self._place, self._activity)

    def _go(self, place: str, activity: str) -> None:
        if self._processor is None:
            return
        wall, cpu = (clock() for clock in self._clocks)
        held = self._open[f"{self._place}/{self._activity}"]
        held[0] += wall - self._then[0]
        held[1] += cpu - self._then[1]
        self._place, self._activity, self._then = place, activity, [wall, cpu]
        if wall - self._settled >= _SETTLE_NS:
            self._settled = wall
            self._share_out(self._processor)

    def _share_out(self, processor: Processor) -> None:
        assert self._cell is not None
        spent, self._open = self._open, defaultdict(lambda: [0, 0])
        walls, cpus = (sum(held[which] for held in spent.values()) for which in (0, 1))
        nj = processor.joules(cpus / _N) * _N
        gpu_nj = 0.0 if self._gpu is None else self._gpu.joules() * _N
        for where, (wall, cpu) in spent.items():
            self._cell(("", f"{where}/{processor.how}", JOULES)).add(round(nj * cpu / max(cpus, 1)), cpu, messages=wall)
            if self._gpu is not None:
                cell = self._cell(("", f"{where}/{self._gpu.how}", JOULES))
                cell.add(round(gpu_nj * wall / max(walls, 1)), 0, messages=wall)
