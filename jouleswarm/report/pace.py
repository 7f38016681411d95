"""How long a run may still take, from how fast it has gone so far. An estimate has a basis, or is told as unknown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario

_BASIS = 2  # rounds whose mean duration is believed
_UNKNOWN = "time left unknown"


class Mark(NamedTuple):
    """Where a cluster, or a stage, stood at a moment."""

    at_s: float
    round: int
    reward: float | None = None
    """R of a cluster."""
    is_over: bool = False


class Span(NamedTuple):
    """The first and the newest mark of a cluster in an arm, or of a stage."""

    first: Mark
    last: Mark

    @property
    def round_s(self) -> float | None:
        """Seconds of a mean round; None before there are two."""
        rounds = self.last.round - self.first.round
        return (self.last.at_s - self.first.at_s) / rounds if rounds >= _BASIS else None


class Left(NamedTuple):
    """Seconds; None: unknown."""

    here_s: float | None
    """Of the stage or arm that is under way."""
    all_s: float | None
    """Of the whole run, if no task is learned before federation.max_rounds."""


def rounds_to_target(span: Span, target: float, max_rounds: int) -> float | None:
    """Rounds until R is at its target if it goes on rising as it has; None where it does not rise."""
    (_, began, low, _), (_, now, high, _) = span
    if span.last.is_over:
        return 0.0
    if low is None or high is None or high <= low or now <= began:
        return None
    return min((target - high) * (now - began) / (high - low), max_rounds - now)


def stage_left_s(span: Span | None, t0: int) -> float | None:
    """Seconds until a stage of `t0` rounds is over."""
    return None if span is None or span.round_s is None else (t0 - span.last.round) * span.round_s


def arm_left_s(spans: Iterable[Span], clusters: int, target: float, max_rounds: int) -> float | None:
    """Seconds until the slowest of an arm's `clusters` has learned; None until all have a basis."""
    found = []
    for span in spans:
        rounds = rounds_to_target(span, target, max_rounds)
        if span.last.is_over:
            found.append(0.0)
        elif rounds is None or span.round_s is None:
            return None
        else:
            found.append(rounds * span.round_s)
    return max(found) if len(found) == clusters and found else None


def most_left_s(scenario: Scenario, arms: Iterable[Arm], spans: Mapping[tuple[str, int], Span]) -> float | None:
    """Seconds that these arms take if no cluster learns before the last round; at the pace of the slowest so far.

    `spans`: by arm and task; task 0 is a method's stage. None where a pace is not known that is needed.
    """
    arms, limit, t0 = list(arms), scenario.federation.max_rounds, scenario.meta.t0
    paces = [span.round_s for (_, task), span in spans.items() if task and span.round_s is not None]
    if not paces:
        return None
    left_s = 0.0
    for arm in arms:
        here = {task: spans.get((arm.name, task)) for task in scenario.clusters}
        ends = (_to_the_end_s(span, limit, max(paces)) for span in here.values())
        left_s += max(ends, default=0.0)
    for method in {arm.method for arm in arms if arm.t0}:
        span = spans.get((method, 0))
        if span is None or span.last.round < t0:
            if (stage_s := stage_left_s(span, t0)) is None:
                return None
            left_s += stage_s
    return left_s


def _to_the_end_s(span: Span | None, limit: int, pace_s: float) -> float:
    """Seconds until a cluster has done `limit` rounds; `pace_s`: of a round where its own is not known."""
    if span is None:
        return limit * pace_s
    return 0.0 if span.last.is_over else (limit - span.last.round) * (span.round_s or pace_s)


def left_text(left: Left, what: str) -> str:
    """`about 50 s left of this arm, 6 min of all at most`; `what`: `arm` or `stage`."""
    if left.here_s is None and left.all_s is None:
        return _UNKNOWN
    most = "" if left.all_s is None else duration_text(left.all_s)
    if left.here_s is None:
        return f"at most {most} left"
    here = f"about {duration_text(left.here_s)} left of this {what}"
    return f"{here}, {most} of all at most" if most else f"{here}, then unknown"


def duration_text(seconds: float) -> str:
    """Two digits of it: 7 s, 85 s, 12 min, 3.5 h, 2.1 days."""
    for unit, factor, least in (("days", 86400.0, 2.0), ("h", 3600.0, 2.0), ("min", 60.0, 2.0)):
        if seconds >= least * factor:
            value = seconds / factor
            return f"{value:.0f} {unit}" if value >= 10 else f"{value:.2g} {unit}"
    return f"{seconds:.0f} s"


class Pace:
    """Keeps the marks that estimates are made of."""

    def __init__(self) -> None:
        self.spans: dict[tuple[str, int], Span] = {}
        """(arm, task) -> marks; of a method's stage (method, 0)."""

    def note(self, arm: str, task: int, mark: Mark) -> None:
        """Take down where somebody stands; what has not moved stays as it was."""
        before = self.spans.get((arm, task))
        if before is None:
            self.spans[arm, task] = Span(mark, mark)
        elif mark.round != before.last.round or mark.is_over != before.last.is_over:
            self.spans[arm, task] = Span(before.first, mark)
