"""Time to learn, from facts alone: T_0 and T_k of each gradient, motions, and bits over each link's rate. Pure.

Facts are sums over rounds, so the slowest robot is the slowest on average: where it is another one in each round,
rounds take longer than told here. Forward passes, encoding and the broker take no time.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.facts import BITS_PER_BYTE, Facts, Flow, Phase, Work, number_of


class Seconds(NamedTuple):
    """Seconds that who waits for a phase or task waits; they are of the slowest."""

    rounds: float
    computing_s: float
    """Gradients and motions."""
    communication_s: float | None
    """None: not known, for nothing was metered or a link that carried something has no rate."""

    @property
    def total_s(self) -> float | None:
        """Both, if both are known."""
        return None if self.communication_s is None else self.computing_s + self.communication_s

    @property
    def round_s(self) -> float | None:
        """Of an average round."""
        return None if self.total_s is None or not self.rounds else self.total_s / self.rounds


class Times(NamedTuple):
    """How long an arm takes: the stage before, then all tasks side by side."""

    ml: Seconds | None
    """None without a stage."""
    tasks: dict[int, Seconds]

    @property
    def total(self) -> Seconds:
        """The stage and the slowest task."""
        last = _slowest(self.tasks.values())
        return last if self.ml is None else _after(self.ml, last)


class Wait(NamedTuple):
    """Seconds that one process of a phase and task waits for others."""

    phase: Phase
    task: int
    who: int
    """A robot's number, or 0 for the data center."""
    seconds: float


def times(facts: Facts, energy: Energy) -> Times:
    """Seconds of an arm; `energy.beta` is a number.

    A task's round is that of its slowest robot, the data center's part of it where it has one, and the communication:
    by `energy.medium` the messages of a cluster one after the other, or all links of a kind at once. Robots that meet
    nobody do not wait. A round of the stage is the slowest training task's motions and uplink, then all gradients; its
    model goes down once, at the end.

    Raises:
        UnknownFactError: only sums are known of these facts.
        ConfigurationError: a link carried something and is not in the user's table.
    """
    has_stage = any(work.phase == "ml" for work in facts.work)
    return Times(
        ml=_stage(facts, energy) if has_stage else None,
        tasks={task: _task(facts, energy, task) for task in facts.rounds},
    )


def waits(facts: Facts, energy: Energy) -> Iterator[Wait]:
    """Who waits for how long: each process for the rest of each of its rounds, once it has computed, moved and sent.

    Robots wait in their own task, and training robots in the stage; the data center in the stage and in each task that
    it has a part in. Where communication is not known, only for the computing of others.
    """
    found = times(facts, energy)
    for task in facts.rounds:
        here = found.tasks[task]
        if here.rounds and _meet(facts, task):
            yield from _waits("fl", task, here, facts, energy)
    if found.ml is not None and found.ml.rounds:
        yield from _waits("ml", 0, found.ml, facts, energy)


def _waits(phase: Phase, task: int, whole: Seconds, facts: Facts, energy: Energy) -> Iterator[Wait]:
    works = [work for work in facts.work if work.phase == phase and (phase == "ml" or work.task == task)]
    flows = [flow for flow in facts.flows if flow.phase == phase and (phase == "ml" or flow.task == task)]
    sent = [flow for flow in facts.sent if flow.phase == phase and flow.task == task]
    known = whole.communication_s is not None
    served = {DATA_CENTER} if any(flow.link != Link.SIDELINK for flow in flows) else set()
    for who in sorted({work.robot for work in works} | served):
        mine = [work for work in works if work.robot == who]
        rounds = whole.rounds if who == DATA_CENTER or phase == "ml" else _rounds(mine, whole.rounds)
        busy = sum(_busy_s(work, energy) for work in mine)
        if known:
            busy += _sending_s(who, flows, sent, energy)
        rest = rounds / whole.rounds * (whole.computing_s + (whole.communication_s or 0.0)) - busy
        if rest > 0:
            yield Wait(phase, task, who, rest)


def _stage(facts: Facts, energy: Energy) -> Seconds:
    works = [work for work in facts.work if work.phase == "ml"]
    flows = [flow for flow in facts.flows if flow.phase == "ml"]
    up = [flow for flow in flows if flow.link == Link.UPLINK]
    groups = []
    for task in {work.task for work in works} | {flow.task for flow in up}:
        moved = max((_busy_s(work, energy) for work in works if work.task == task and work.robot), default=0.0)
        arrived = _moving_s([flow for flow in up if flow.task == task], (), energy)
        groups.append(_seconds(facts, facts.t0, moved, arrived))
    computing_s = sum(_busy_s(work, energy) for work in works if work.robot == DATA_CENTER)
    clusters = _clusters(facts)
    down: dict[int, list[Flow]] = {}
    for flow in flows:
        if flow.link == Link.DOWNLINK:
            down.setdefault(clusters.get(number_of(flow.receiver), 0), []).append(flow)
    down_s = max((_moving_s(held, (), energy) for held in down.values()), default=0.0)
    return _after(_slowest(groups), _seconds(facts, 0, computing_s, down_s))._replace(rounds=facts.t0)


def _task(facts: Facts, energy: Energy, task: int) -> Seconds:
    """Communication of a method whose rounds meet the data center is the way up and then the way down."""
    rounds = facts.rounds[task]
    works = [work for work in facts.work if work.phase == "fl" and work.task == task]
    center_s = sum(_busy_s(work, energy) for work in works if work.robot == DATA_CENTER)
    robots = {work.robot: _busy_s(work, energy) for work in works if work.robot != DATA_CENTER}
    if _meet(facts, task):  # a robot that left early counts as long as it was there by its rounds, not by its sum
        took = {work.robot: _rounds([work], rounds) for work in works}
        robots = {robot: busy * rounds / took[robot] if took[robot] else 0.0 for robot, busy in robots.items()}
    flows = [flow for flow in facts.flows if flow.phase == "fl" and flow.task == task]
    sent = [flow for flow in facts.sent if flow.task == task]
    moving_s = sum(_moving_s([flow for flow in flows if flow.link == link], sent, energy) for link in Link)
    return _seconds(facts, rounds, max(robots.values(), default=0.0) + center_s, moving_s)


def _meet(facts: Facts, task: int) -> bool:
    """Whether a task's robots wait for anybody."""
    return bool(facts.links.get(task)) or any(flow.phase == "fl" and flow.task == task for flow in facts.flows)


def _rounds(works: Iterable[Work], otherwise: float) -> float:
    """Rounds that a robot was there for."""
    return sum(work.rounds for work in works) or otherwise


def _busy_s(work: Work, energy: Energy) -> float:
    """Gradients and motions of one process."""
    if work.robot == DATA_CENTER:
        assert energy.beta != "measured"
        return (work.plain + energy.beta * work.exact) * energy.t0_batch_s
    here = energy.of(work.robot)
    return (work.plain + work.exact) * here.tk_batch_s + (work.motions + work.evaluation_motions) * here.motion_s


def _moving_s(flows: Collection[Flow], sent: Iterable[Flow], energy: Energy) -> float:
    """What flows of one kind take, all rounds together; infinite where a rate is not known.

    `sent`: of sidelinks via the base station, where a message goes up once and down to each neighbour.
    """
    paths = [(number_of(flow.sender), [_hop_s(*hop, flow, energy) for hop in _hops(flow, energy)]) for flow in flows]
    ups = _ups(flows, sent, energy)
    if energy.medium == "own":
        return max((ups.get(sender, 0.0) + sum(hops) for sender, hops in paths), default=0.0)
    return sum(ups.values()) + sum(sum(hops) for _, hops in paths)


def _sending_s(who: int, flows: Iterable[Flow], sent: Iterable[Flow], energy: Energy) -> float:
    """What one process sends itself, or passes on, of all that."""
    flows = list(flows)
    own = [_hop_s(*hop, flow, energy) for flow in flows for hop in _hops(flow, energy) if hop[0] == who]
    if who in (ups := _ups(flows, sent, energy)):
        own.append(ups[who])
    return max(own, default=0.0) if energy.medium == "own" else sum(own)


def _ups(flows: Iterable[Flow], sent: Iterable[Flow], energy: Energy) -> dict[int, float]:
    """Sender -> seconds of its way up to the base station, where sidelinks go by it."""
    via = energy.sidelink == "via_base_station" and any(flow.link == Link.SIDELINK for flow in flows)
    return {number_of(each.sender): _hop_s(number_of(each.sender), DATA_CENTER, each, energy) for each in sent if via}


def _hops(flow: Flow, energy: Energy) -> tuple[tuple[int, int], ...]:
    """The links that a flow goes over; of sidelinks via the base station the way down alone."""
    sender, receiver = number_of(flow.sender), number_of(flow.receiver)
    if flow.link == Link.SIDELINK and energy.sidelink == "via_base_station":
        return ((DATA_CENTER, receiver),)
    via = energy.link(sender, receiver).via
    return ((sender, receiver),) if via is None else ((sender, via), (via, receiver))


def _hop_s(sender: int, receiver: int, flow: Flow, energy: Energy) -> float:
    """Payload bits over the link's rate, over 1 - p where a share p is lost and sent again."""
    link = energy.link(sender, receiver)
    if not flow.payload_bytes:
        return 0.0
    return math.inf if link.bit_per_s is None else flow.payload_bytes * BITS_PER_BYTE / link.bit_per_s / (1 - link.loss)


def _clusters(facts: Facts) -> dict[int, int]:
    """Robot -> task: robots are numbered from 1 in the order of the tasks."""
    tasks = [task for task, robots in facts.robots.items() for _ in range(robots)]
    return dict(enumerate(tasks, start=1))


def _seconds(facts: Facts, rounds: float, computing_s: float, moving_s: float) -> Seconds:
    known = facts.metered and math.isfinite(moving_s)
    return Seconds(rounds, computing_s, moving_s if known else None)


def _slowest(found: Collection[Seconds]) -> Seconds:
    """By all seconds where they are known of every one, else by computing."""
    if any(each.total_s is None for each in found):
        return max(found, key=lambda each: each.computing_s)._replace(communication_s=None)
    return max(found, key=lambda each: each.total_s or 0.0, default=Seconds(0.0, 0.0, 0.0))


def _after(first: Seconds, then: Seconds) -> Seconds:
    known = None not in (first.communication_s, then.communication_s)
    moving_s = (first.communication_s or 0.0) + (then.communication_s or 0.0) if known else None
    return Seconds(first.rounds + then.rounds, first.computing_s + then.computing_s, moving_s)
