"""What a scenario will cost, before anything runs: a round and the whole in closed form, memory and disk. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import NamedTuple

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import CAUSES, Bill, Cost
from jouleswarm.energy.facts import Counts, Facts, Phase
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.runs.arm_facts import in_closed_form, links_of
from jouleswarm.runs.interface import interface_of
from jouleswarm.runs.sizes import scenario_sizes

_AMOUNT = {
    "computing_datacenter": ("gradients_support", "gradients_query"),
    "computing_robots": ("gradients_robots",),
    "uplink": ("uplink_bytes",),
    "downlink": ("downlink_bytes",),
    "sidelink": ("sidelink_bytes",),
}
_FLOAT32_BYTES = 4
_BESIDE_FRAME_BYTES = 21  # action, reward, two flags and a checksum of each frame that is remembered
_STATES = 2  # the newest two of each process


class Line(NamedTuple):
    """What a round of all clusters (of the stage: of all that train) has of one cause."""

    arm: str
    phase: Phase
    cause: str
    """A key of `energy.bill.CAUSES`."""
    amount: float
    """Batch gradients; bytes over links; nothing else is told in counts."""
    joules: float
    once: bool
    """What is not of every round: the meta-model's way down."""


class Room(NamedTuple):
    """Bytes, interpreter and PyTorch apart."""

    robot: float
    """Of one robot's process: replay memory, and its model, target, gradient and optimizer."""
    datacenter: float
    whole: float
    disk: float
    """States, frames and weights in the run directory; the states go when it is complete."""


def foretold_facts(scenario: Scenario, arm: Arm, t0: float, rounds: float) -> Facts:
    """An arm's facts if each task takes `rounds` rounds, behind a stage of `t0`."""
    tasks = dict.fromkeys(scenario.clusters, float(rounds))
    empty = Facts(
        arm=arm.name,
        method=arm.method,
        t0=t0,
        parts={},
        rounds=tasks,
        robots={task: len(cluster) for task, cluster in scenario.clusters.items()},
        links=links_of(scenario, arm.method),
        training_robots=sum(len(agents) for agents in scenario.training_agents.values()) if t0 else None,
        exact=scenario.method(arm.method).exact,
    )
    return in_closed_form(empty, scenario, tasks, scenario_sizes(scenario))


def round_lines(scenario: Scenario) -> Iterator[Line]:
    """A round of each arm, by phase and cause at literal prices; with a codec that builds on what is known, not the
    first one.

    Raises:
        ConfigurationError: a link is not in the user's table.
    """
    for arm in scenario.arms:
        steps = [foretold_facts(scenario, arm, t0, n) for t0, n in ((1 if arm.t0 else 0, 0), (0, 1), (0, 2))]
        stage, one, two = ((facts.counts, price(literal, facts, scenario.energy) or Bill()) for facts in steps)
        yield from _lines(arm.name, "ml", (stage[0].ml, stage[1].ml), (Counts(), Cost()))
        yield from _lines(arm.name, "fl", (two[0].fl, two[1].fl), (one[0].fl, one[1].fl))


def room_of(scenario: Scenario) -> Room:
    """Memory and disk at their fullest, from the sizes of what is kept."""
    interface, learning, meta = interface_of(scenario), scenario.learning, scenario.meta
    model = _FLOAT32_BYTES * sum(interface.entries)
    kept = interface.spaces.observation.kept(scenario.network).nbytes + _BESIDE_FRAME_BYTES
    moments = 2 if learning.optimizer == "adam" else 0
    replay = (learning.replay_size + 2 * learning.motions_per_round) * kept
    trained = [agent for agents in scenario.training_agents.values() for agent in agents]
    experience = sum(meta.replay_size + 2 * scenario.motions(agent) for agent in trained) * kept
    learners = len(scenario.clusters) if scenario.is_learned_centrally else 0
    robot = replay + (3 + moments) * model
    center = bool(scenario.meta_methods) * (experience + (3 + moments) * model) + learners * robot
    files = replay + _STATES * (2 + moments) * model
    models = len(scenario.arms) * len(scenario.clusters) + len(scenario.meta_methods) * (1 + len(meta.snapshots))
    robots = len(scenario.agents)
    return Room(robot, center, robots * robot + center, robots * files + center + models * model)


def compare(foretold: Facts, counted: Facts) -> dict[str, tuple[float, float]]:
    """`phase link` -> bytes a round as foretold and as counted, of links that either has used."""
    found = {}
    for phase in ("ml", "fl"):
        rounds = counted.t0 if phase == "ml" else sum(counted.rounds.values())
        for link in ("uplink", "downlink", "sidelink"):
            said, was = (getattr(getattr(each.counts, phase), f"{link}_bytes") for each in (foretold, counted))
            if rounds and (said or was):
                found[f"{phase} {link}"] = (said / rounds, was / rounds)
    return found


def _lines(arm: str, phase: Phase, to: tuple[Counts, Cost], since: tuple[Counts, Cost]) -> Iterator[Line]:
    counts, before = asdict(to[0]), asdict(since[0])
    for cause in CAUSES:
        amount = sum(counts[name] - before[name] for name in _AMOUNT.get(cause.key, ()))
        joules = to[1].by_cause[cause] - since[1].by_cause[cause]
        if amount or joules:
            yield Line(arm, phase, cause.key, amount, joules, (phase, cause.key) == ("ml", "downlink"))
