"""What had been spent, and what had been learned by then. Pure.

Clusters learn side by side: after round r each has done r rounds, or the t_i that it took. Of a task's totals each
round has the same part; what goes down to robots before the first round is part of the stage.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from jouleswarm.energy.facts import Counts, Facts, Flow, Phase, Work


class Point(NamedTuple):
    """An arm after a round."""

    round: int
    facts: Facts
    """What had been done by then."""
    learned: tuple[int, ...]
    """Tasks."""


def until(facts: Facts, round_: float) -> Facts:
    """The facts as they were after so many rounds of every cluster; the stage before them is whole."""
    share = {task: min(1.0, round_ / took) if took else 1.0 for task, took in facts.rounds.items()}

    def part(phase: Phase, task: int) -> float:
        return share.get(task, 1.0) if phase == "fl" else 1.0

    def counts(phase: Phase, task: int, held: Counts) -> Counts:
        return Counts(*(part(phase, task) * value for value in vars(held).values()))

    flows, work, sent = facts.known_flows, facts.known_work, facts.known_sent
    return replace(
        facts,
        parts={key: counts(*key, held) for key, held in facts.parts.items()},
        rounds={task: share[task] * took for task, took in facts.rounds.items()},
        known_flows=None if flows is None else tuple(_flow(each, part(*each[:2])) for each in flows),
        known_work=None if work is None else tuple(_work(each, part(*each[:2])) for each in work),
        known_sent=None if sent is None else tuple(_flow(each, part(*each[:2])) for each in sent),
    )


def curve(facts: Facts, learned: Mapping[int, bool]) -> Iterator[Point]:
    """An arm after round 0, which is the stage alone, 1, 2 and so on until its last cluster is done.

    Args:
        facts: of the arm; rounds by task are known.
        learned: task -> whether it was learned in the rounds that it took.
    """
    for round_ in range(int(max(facts.rounds.values(), default=0)) + 1):
        yield Point(round_, until(facts, round_), _learned_by(facts, learned, round_))


def _learned_by(facts: Facts, learned: Mapping[int, bool], round_: int) -> tuple[int, ...]:
    """Tasks that were learned in so many rounds."""
    return tuple(task for task, took in facts.rounds.items() if learned[task] and took <= round_)


def _flow(flow: Flow, part: float) -> Flow:
    moved = {name: part * getattr(flow, name) for name in ("messages", "payload_bytes", "packet_bytes")}
    return flow._replace(**moved)


def _work(work: Work, part: float) -> Work:
    done = {name: part * getattr(work, name) for name in Work._fields[3:]}
    return work._replace(**done)
