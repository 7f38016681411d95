"""Settings that are each within bounds and must fit together: nothing that a run draws from may be empty, and nothing
that it keeps or sends may be larger than memory and messages are. Pure; each complaint names all fields behind it.
"""

from __future__ import annotations

from collections.abc import Iterator

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Federation
from jouleswarm.common.scenario.spaces import Interface, Spaces, shipped_tensors

MAX_ROBOTS = 1000
MAX_PARAMETERS = 60_000_000
"""As float32 240 MB: an MQTT packet holds 268 MB at most."""
MAX_KEPT_BYTES = 64 * 2**30
"""Of one kind of thing that one process keeps in memory or in a file."""


def misfits(scenario: Scenario) -> Iterator[str]:
    """What does not fit together, a line each; a scenario without any can be run.

    What follows from sizes is seen here where they are known, else once they are (`size_misfits`).
    """
    yield from _crowds(scenario)
    yield from _empty_draws(scenario)
    yield from getattr(scenario.factory, "check", lambda scenario: ())(scenario)
    if (spaces := scenario.known_spaces) is not None:
        yield from size_misfits(scenario, spaces, scenario.interface or shipped_tensors(scenario.network, spaces))


def size_misfits(scenario: Scenario, spaces: Spaces, interface: Interface | None) -> Iterator[str]:
    """What does not fit of a scenario whose environment is known, and perhaps its network."""
    if interface is not None:
        yield from _network(scenario, interface)
    yield from _space(scenario, spaces)


def _crowds(scenario: Scenario) -> Iterator[str]:
    robots = len(scenario.agents)
    if robots > MAX_ROBOTS:
        yield (
            f"tasks and federation.robots_per_cluster {scenario.federation.robots_per_cluster} come to {robots} "
            f"robots, expected {MAX_ROBOTS} at most"
        )
    federation: Federation = scenario.federation
    for task, cluster in scenario.clusters.items():
        if federation.topology == "random" and federation.degree == 1 and len(cluster) > 2:
            has = len(cluster)
            yield f"federation.degree 1 joins robots in pairs only, and task {task} has {has}; expected 2 or more"


def _network(scenario: Scenario, interface: Interface) -> Iterator[str]:
    network, takes = scenario.network, interface.spaces.observation.kept(scenario.network)
    if 0 in interface.entries:
        yield (
            f"network.conv {list(map(list, network.conv))} leaves nothing of network.width x network.height "
            f"{takes.shape[1]} x {takes.shape[0]}; use a larger input or smaller kernels"
        )
    elif (parameters := sum(interface.entries)) > MAX_PARAMETERS:
        named = "network.width, height, conv and dense come" if network.build is None else "the network's layers come"
        yield f"{named} to {parameters} parameters, expected {MAX_PARAMETERS} at most"


def _empty_draws(scenario: Scenario) -> Iterator[str]:
    """The data center learns from a motion once the next one of its episode has come (see datacenter/experience.py)."""
    fewest = min(map(scenario.motions, scenario.agents))
    if (drawing := scenario.experience_methods) and fewest < 2:
        yield (
            f"learning.motions_per_round is 1 and methods has {', '.join(drawing)}: the data center would have rounds "
            "without a motion and the one after it to learn from; expected 2 or more"
        )


def _space(scenario: Scenario, spaces: Spaces) -> Iterator[str]:
    """Everything whose size is a product of settings."""
    learning, meta, kept = scenario.learning, scenario.meta, spaces.observation.kept(scenario.network)
    taken, seen = spaces.observation.nbytes, kept.nbytes
    shown = "network.width x network.height" if kept.is_image else f"{kept}"
    largest = max(map(len, scenario.clusters.values()))
    together = largest if scenario.is_learned_centrally else 1
    batches, motions = max(map(scenario.batches, scenario.agents)), max(map(scenario.motions, scenario.agents))
    sizes = {
        f"learning.replay_size x {shown}": learning.replay_size * seen * together,
        f"learning.batches_per_round x learning.batch_size x {shown}": (
            10 * batches * learning.batch_size * seen * together
        ),
        f"learning.motions_per_round x {spaces.observation}": motions * taken * together,
    }
    if scenario.meta_methods:
        training = sum(map(len, scenario.training_agents.values()))
        draws = meta.support_batches + meta.query_batches
        sizes |= {
            f"meta.replay_size x {shown}": training * meta.replay_size * seen,
            f"meta.support_batches + meta.query_batches x meta.batch_size x {shown}": (
                8 * training * draws * meta.batch_size * seen
            ),
            f"learning.motions_per_round x {shown}": 2 * training * motions * seen,
        }
    for names, size in sizes.items():
        if size > MAX_KEPT_BYTES:
            yield f"{names} come to {size / 2**30:.0f} GiB for one process, expected {MAX_KEPT_BYTES >> 30} GiB at most"
