"""A study's sums shared out: each robot and link of a cluster has the same part, which is what times are told by."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice, permutations

from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.facts import STAGE, Facts, Flow, Phase, Work
from jouleswarm.studies.facts import META_STAGE, Fact
from jouleswarm.studies.prices import facts_of, task_stages


def shared_out(run: Sequence[Fact], scenario: Scenario) -> Facts:
    """The facts of one arm of one run with work and flows. Messages are not known and 0.

    Args:
        run: one fact a stage, with motions.
        scenario: by whose settings training robots move.
    """
    work: list[Work] = []
    flows: list[Flow] = []
    sent: list[Flow] = []
    first = 1
    for fact in task_stages(run):
        robots, task = range(first, first + fact.robots), fact.task
        first += fact.robots
        work += _work("fl", {task: robots}, fact)
        flows += _flows("fl", task, Link.UPLINK, [(robot, DATA_CENTER) for robot in robots], fact.uplink_bytes)
        flows += _flows("fl", task, Link.DOWNLINK, [(DATA_CENTER, robot) for robot in robots], fact.downlink_bytes)
        edges = list(islice(permutations(robots, 2), fact.links))
        flows += _flows("fl", task, Link.SIDELINK, edges, fact.sidelink_bytes)
        sent += _flows("fl", task, Link.SIDELINK, [(robot, robot) for robot in robots], fact.sidelink_sent_bytes)
    for stage in (fact for fact in run if fact.task == META_STAGE):
        training = _training(stage, scenario)
        work += _work("ml", training, stage)
        up_bytes = stage.uplink_bytes / max(1, sum(map(len, training.values())))
        for task, cluster in training.items():
            ends = [(robot, DATA_CENTER) for robot in cluster]
            flows += _flows("ml", task, Link.UPLINK, ends, up_bytes * len(cluster))
        down = [(DATA_CENTER, robot) for robot in range(1, 1 + stage.robots)]
        flows += _flows("ml", STAGE, Link.DOWNLINK, down, stage.downlink_bytes)
    return replace(facts_of(run), known_work=tuple(work), known_flows=tuple(flows), known_sent=tuple(sent))


def training_robots(stage: Fact, scenario: Scenario) -> int:
    """How many robots sent experience up in a stage."""
    motions = stage.t0 * scenario.learning.motions_per_round
    return round((stage.motions or 0) / motions) if motions else 0


def _training(stage: Fact, scenario: Scenario) -> dict[int, Sequence[int]]:
    """Training tasks, numbered from 1, with their robots."""
    robots, each = range(1, 1 + training_robots(stage, scenario)), scenario.meta.robots_per_task
    return {place: robots[at : at + each] for place, at in enumerate(range(0, len(robots), each), start=1)}


def _work(phase: Phase, clusters: Mapping[int, Sequence[int]], fact: Fact) -> Iterator[Work]:
    """Of a stage's robots, and of the data center for it."""
    yield Work(phase, fact.task, DATA_CENTER, fact.gradients_support, fact.gradients_query, 0.0, fact.rounds)
    among = sum(map(len, clusters.values()))
    gradients, motions, evaluating = (
        (whole or 0) / max(1, among) for whole in (fact.gradients_robots, fact.motions, fact.evaluation_motions)
    )
    for task, robots in clusters.items():
        for robot in robots:
            yield Work(phase, task, robot, gradients, 0, 0.0, fact.rounds, motions, evaluating)


def _flows(phase: Phase, task: int, link: Link, ends: Collection[tuple[int, int]], whole: float) -> Iterator[Flow]:
    for sender, receiver in ends if whole else ():
        each = whole / len(ends)
        yield Flow(phase, task, link, client_of(sender), client_of(receiver), 0, each, each)
