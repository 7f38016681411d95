"""What meters read, held against a run's own times: joules of each arm, phase and process. Pure; no prices."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from jouleswarm.common.scenario.arms import method_of, snapshot_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import Array, RowPhase
from jouleswarm.energy.facts import Phase
from jouleswarm.runs.power_log import Log

_GAP = 5.0
"""Two samples that are further apart than so many times what is usual have a hole between them."""

Key = tuple[str, str, int, int, int]
"""A row's phase, arm, task, agent and round."""
Span = tuple[float, float]
"""Begin and end, seconds since 1970."""


class RowTime(BaseModel):
    """When a row came, by the recorder's clock: a line of `times.jsonl`."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    time_s: float
    phase: Literal["maml", "fl"]
    arm: str
    task: int
    agent: int
    round: int


class Power(NamedTuple):
    """A device's power: a straight line from one sample to the next, unknown in the holes. Arrays are [pieces]."""

    begin_s: Array
    end_s: Array
    begin_w: Array
    end_w: Array
    holes: list[Span]

    def within(self, spans: Sequence[Span]) -> tuple[float, float]:
        """Joules of these spans, by the trapezoid, and how many of their seconds are known."""
        edges = np.array(spans, dtype=np.float64).reshape(-1, 2)
        joules, seconds = self._until(edges)
        return float((joules[:, 1] - joules[:, 0]).sum()), float((seconds[:, 1] - seconds[:, 0]).sum())

    def _until(self, at_s: Array) -> tuple[Array, Array]:
        """Joules and known seconds from the first sample on."""
        length_s = self.end_s - self.begin_s
        whole_j = np.concatenate([[0.0], np.cumsum(length_s * (self.begin_w + self.end_w) / 2)])
        whole_s = np.concatenate([[0.0], np.cumsum(length_s)])
        if not len(length_s):
            return np.zeros_like(at_s), np.zeros_like(at_s)
        here = np.maximum(np.searchsorted(self.begin_s, at_s, side="right") - 1, 0)
        into_s = np.clip(at_s - self.begin_s[here], 0.0, length_s[here])
        slope = (self.end_w - self.begin_w)[here] / length_s[here]
        return whole_j[here] + into_s * (self.begin_w[here] + slope * into_s / 2), whole_s[here] + into_s


class Read(NamedTuple):
    """What the meters of one process read while it did its rounds of an arm's phase."""

    arm: str
    phase: Phase
    agent: int
    """A robot's number; 0: the data center."""
    seconds: float
    known_s: float
    """Of them, those that all of its meters saw."""
    joules: float


def power_of(log: Log, shift_s: float = 0.0) -> Power:
    """A log as power over time, its clock set forward by `shift_s`; a counter that went back has a hole there."""
    time_s, values = np.array(log.time_s) + shift_s, np.array(log.values)
    length_s = np.diff(time_s)
    known = length_s <= _GAP * np.median(length_s) if len(length_s) else np.ones(0, dtype=bool)
    begin_w, end_w = values[:-1], values[1:]
    if log.is_counter:
        known &= end_w >= begin_w
        begin_w = end_w = (end_w - begin_w) / length_s
    begin_s, end_s = time_s[:-1], time_s[1:]
    holes = list(zip(begin_s[~known].tolist(), end_s[~known].tolist(), strict=True))
    return Power(begin_s[known], end_s[known], begin_w[known], end_w[known], holes)


def spans_of(rows: Iterable[RoundRow], times: Iterable[RowTime]) -> dict[Key, Span]:
    """Begin and end of each row's round: it ended when it came, but before the process's next round began.

    So rounds that came all at once, after a lost connection, lie one after the other. A row without a time has none.
    """
    took_s = {_key(row): row.seconds for row in rows}
    first: dict[Key, float] = {}
    for each in times:  # a row that was told again was there already
        first.setdefault(_key(each), each.time_s)
    spans: dict[Key, Span] = {}
    next_s: dict[int, float] = {}
    for key, time_s in reversed(first.items()):
        if key in took_s:
            end_s = min(time_s, next_s.get(key[3], time_s))
            spans[key] = next_s[key[3]], _ = end_s - took_s[key], end_s
    return spans


def read(
    rows: Iterable[RoundRow], spans: Mapping[Key, Span], arm: str, powers: Mapping[int, Sequence[Power]]
) -> Iterator[Read]:
    """What was read of an arm: of the phase ml that it shares, the rounds up to its own; meters of a process add up."""
    found: dict[tuple[Phase, int], list[RoundRow]] = {}
    for row in rows:
        if (row.phase, row.arm) == (RowPhase.ML, method_of(arm)) and row.round <= (snapshot_of(arm) or row.round):
            found.setdefault(("ml", row.agent), []).append(row)
        elif (row.phase, row.arm) == (RowPhase.FL, arm):
            found.setdefault(("fl", row.agent), []).append(row)
    for (phase, agent), mine in sorted(found.items(), key=lambda each: (each[0][0] != "ml", each[0][1])):
        if agent in powers:
            timed = [spans[_key(row)] for row in mine if _key(row) in spans]
            held = [power.within(timed) for power in powers[agent]]
            joules, known_s = sum(each for each, _ in held), min(seconds for _, seconds in held)
            yield Read(arm, phase, agent, sum(row.seconds for row in mine), known_s, joules)


def _key(row: RoundRow | RowTime) -> Key:
    return row.phase, row.arm, row.task, row.agent, row.round
