"""The closed form of an arm, robot by robot and link by link: who computes and sends the counts that rounds come to.

What goes over the links is as the bus really has it: a message a motion of experience, a message a round of weights to
each neighbour (sent once), one of the meta-model to each robot; of each the payload, as nothing is known of packets.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import TypeVar

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.closed_form import RoundSizes
from jouleswarm.energy.facts import STAGE, Counts, Flow, Phase, StageCounts, UnknownFactError, Work
from jouleswarm.methods.graph import directed_edges

Key = TypeVar("Key")
Parts = Mapping[tuple[Phase, int], Counts]


def closed_parts(
    scenario: Scenario, method: str, t0: float, rounds: Mapping[int, float], sizes: RoundSizes
) -> dict[tuple[Phase, int], Counts]:
    """Counts of phase ml, and of each task's own rounds, by the method's equations."""
    form = scenario.method(method).closed_form
    tasks: dict[int, StageCounts] = {task: form(scenario, 0, {task: each}, sizes) for task, each in rounds.items()}
    parts: dict[tuple[Phase, int], Counts] = {("fl", task): tasks[task].fl for task in tasks}
    parts["ml", STAGE] = form(scenario, t0, rounds, sizes).ml
    return parts


def closed_work(
    scenario: Scenario, t0: float, rounds: Mapping[int, float], sizes: RoundSizes, parts: Parts
) -> Iterator[Work]:
    """What each process computes and moves of `parts`; sums are the counts. How long greedy episodes are is not known:
    they have no motions here."""
    stage, training = parts["ml", STAGE], scenario.training_agents if t0 else {}
    sites = {task: float(len(robots)) for task, robots in training.items()}
    plain, exact = (_shared(whole, sites) for whole in (stage.gradients_support, stage.gradients_query))
    for task, robots in training.items():
        yield Work("ml", task, 0, plain.get(task, 0), exact.get(task, 0), 0.0, t0)
        for robot in robots:
            yield Work("ml", task, robot, 0, 0, 0.0, t0, t0 * scenario.motions(robot))
    for task, done in rounds.items():
        if not done:
            continue
        counts, batches = parts["fl", task], {robot: sizes.batches([robot]) for robot in scenario.cluster(task)}
        for robot, gradients in _shared(counts.gradients_robots, batches).items():
            yield Work("fl", task, robot, gradients, 0, 0.0, done, done * scenario.motions(robot))
        if counts.gradients_support or counts.gradients_query:
            yield Work("fl", task, 0, counts.gradients_support, counts.gradients_query, 0.0, done)


def closed_flows(
    scenario: Scenario, method: str, t0: float, rounds: Mapping[int, float], sizes: RoundSizes, parts: Parts
) -> Iterator[Flow]:
    """What is delivered over each link; sums are the counts."""
    stage, sends = parts["ml", STAGE], scenario.method(method).sends
    training = {robot: task for task, robots in scenario.training_agents.items() for robot in robots}
    up = _shared(stage.uplink_bytes, {robot: sizes.experience([robot]) for robot in training})
    for robot, payload in up.items():
        yield _flow("ml", training[robot], Link.UPLINK, robot, 0, t0 * scenario.motions(robot), payload)
    everybody = dict.fromkeys((robot for task in rounds for robot in scenario.cluster(task)), 1.0)
    for robot, payload in _shared(stage.downlink_bytes, everybody).items():
        yield _flow("ml", STAGE, Link.DOWNLINK, 0, robot, 1, payload)
    for task, done in rounds.items():
        counts, cluster = parts["fl", task], dict.fromkeys(scenario.cluster(task), 1.0)
        weighed = {robot: sizes.experience([robot]) for robot in cluster} if sends == "experience" else cluster
        for robot, payload in _shared(counts.uplink_bytes, weighed).items():
            messages = done * (scenario.motions(robot) if sends == "experience" else 1)
            yield _flow("fl", task, Link.UPLINK, robot, 0, messages, payload)
        for robot, payload in _shared(counts.downlink_bytes, cluster).items():
            yield _flow("fl", task, Link.DOWNLINK, 0, robot, done, payload)
        edges = dict.fromkeys(directed_edges(scenario, task), 1.0)
        for (sender, receiver), payload in _shared(counts.sidelink_bytes, edges).items():
            yield _flow("fl", task, Link.SIDELINK, sender, receiver, done, payload)


def closed_sent(scenario: Scenario, rounds: Mapping[int, float], parts: Parts) -> Iterator[Flow]:
    """What robots send over sidelinks, each message once."""
    for task, done in rounds.items():
        senders = dict.fromkeys(scenario.cluster(task), 1.0)
        for robot, payload in _shared(parts["fl", task].sidelink_sent_bytes, senders).items():
            yield Flow("fl", task, Link.SIDELINK, client_of(robot), "", done, payload, payload)


def _flow(phase: Phase, task: int, link: Link, sender: int, receiver: int, messages: float, payload: float) -> Flow:
    return Flow(phase, task, link, client_of(sender), client_of(receiver), messages, payload, payload)


def _shared(whole: float, weights: Mapping[Key, float]) -> dict[Key, float]:
    """`whole` by weight, each part rounded once; nothing of nothing.

    Raises:
        UnknownFactError: nobody is there to whom it could belong, as a method of the user's own may have it.
    """
    exact = {key: Fraction(weight) for key, weight in weights.items()}
    if whole and not exact:
        raise UnknownFactError("the method's closed form has more than its robots and links can do")
    return {key: float(Fraction(whole) * each / sum(exact.values())) for key, each in exact.items()} if whole else {}
