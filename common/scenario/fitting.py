"""Settings that are each within bounds and must fit together: nothing that a run draws from may be empty, and nothing
that it keeps or sends may be larger than memory and messages are. Pure; each complaint names all fields behind it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Federation, Network
from jouleswarm.common.wire.messages import MAX_REWARD
from jouleswarm.environments.landmarks.maps import TaskMap

CHANNELS = ACTIONS = 4  # see learning.networks
MAX_ROBOTS = 1000
MAX_PARAMETERS = 60_000_000
"""As float32 240 MB: an MQTT packet holds 268 MB at most."""
MAX_KEPT_BYTES = 64 * 2**30
"""Of one kind of thing that one process keeps in memory or in a file."""


def misfits(scenario: Scenario) -> Iterator[str]:
    """What does not fit together, a line each; a scenario without any can be run."""
    yield from _crowds(scenario)
    yield from _network(scenario.network)
    yield from _empty_draws(scenario)
    for task in scenario.tasks:
        yield from _rewards(scenario, task.id, scenario.task_map(task.id))
    yield from _space(scenario)


def parameter_count(network: Network) -> int:
    """Parameters of the Q-network; 0 where the convolutions leave nothing of the input."""
    channels, height, width, count = CHANNELS, network.height, network.width, 0
    for out, kernel, stride in network.conv:
        count += out * (channels * kernel * kernel + 1)
        channels, height, width = out, (height - kernel) // stride + 1, (width - kernel) // stride + 1
        if height < 1 or width < 1:
            return 0
    features = channels * height * width
    for size in (*network.dense, ACTIONS):
        count, features = count + size * (features + 1), size
    return count


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


def _network(network: Network) -> Iterator[str]:
    parameters = parameter_count(network)
    if parameters == 0:
        yield (
            f"network.conv {list(map(list, network.conv))} leaves nothing of network.width x network.height "
            f"{network.width} x {network.height}; use a larger input or smaller kernels"
        )
    elif parameters > MAX_PARAMETERS:
        yield (
            f"network.width, height, conv and dense come to {parameters} parameters, expected {MAX_PARAMETERS} at most"
        )


def _empty_draws(scenario: Scenario) -> Iterator[str]:
    """The data center learns from a motion once the next one of its episode has come (see datacenter/experience.py)."""
    drawing = scenario.experience_methods
    fewest = min(map(scenario.motions, scenario.agents))
    for name, value in (("learning.motions_per_round", fewest), ("world.max_motions", scenario.world.max_motions)):
        if drawing and value < 2:
            yield (
                f"{name} is 1 and methods has {', '.join(drawing)}: the data center would have rounds "
                "without a motion and the one after it to learn from; expected 2 or more"
            )


def _rewards(scenario: Scenario, task: int, task_map: TaskMap) -> Iterator[str]:
    """No message holds a return beyond `MAX_REWARD`."""
    world, own = scenario.world, scenario.task(task).rewards
    off_path = abs(world.off_path_reward) * (task_map.rows + task_map.cols)
    on_path = abs(world.path_reward) + world.path_slope
    made = (abs(world.exit_reward), abs(world.obstacle_reward), on_path + off_path)
    largest = max(map(abs, own), default=0.0) if own is not None else max(made)
    if largest * world.max_motions > MAX_REWARD:
        yield (
            f"world.max_motions {world.max_motions} at rewards of up to {largest:g} (task {task}) add up to "
            f"{largest * world.max_motions:g}, expected {MAX_REWARD:g} at most"
        )


def _space(scenario: Scenario) -> Iterator[str]:
    """Everything whose size is a product of settings."""
    camera, network, learning, meta = scenario.camera, scenario.network, scenario.learning, scenario.meta
    taken, seen = 4 * camera.width * camera.height, 4 * network.width * network.height
    largest = max(map(len, scenario.clusters.values()))
    together = largest if scenario.is_learned_centrally else 1
    training = sum(map(len, scenario.training_agents.values())) if scenario.meta_methods else 0
    batches, motions = max(map(scenario.batches, scenario.agents)), max(map(scenario.motions, scenario.agents))
    draws = meta.support_batches + meta.query_batches
    views = math.prod((3, scenario.world.rows, scenario.world.cols, taken // 4 + 1, 4))  # see landmarks/camera.py
    kept = {
        "camera.width x camera.height x world.rows x world.cols": views,
        "learning.replay_size x network.width x network.height": learning.replay_size * seen * together,
        "learning.batches_per_round x learning.batch_size x network.width x network.height": (
            10 * batches * learning.batch_size * seen * together
        ),
        "learning.motions_per_round x camera.width x camera.height": motions * taken * together,
    }
    if scenario.meta_methods:
        kept |= {
            "meta.replay_size x network.width x network.height": training * meta.replay_size * seen,
            "meta.support_batches + meta.query_batches x meta.batch_size x network.width x network.height": (
                8 * training * draws * meta.batch_size * seen
            ),
            "learning.motions_per_round x network.width x network.height": 2 * training * motions * seen,
        }
    for names, size in kept.items():
        if size > MAX_KEPT_BYTES:
            yield f"{names} come to {size / 2**30:.0f} GiB for one process, expected {MAX_KEPT_BYTES >> 30} GiB at most"
    if camera.pose_jitter_m > scenario.world.cell_m / 2:
        yield (
            f"camera.pose_jitter_m {camera.pose_jitter_m:g} is more than half of world.cell_m "
            f"{scenario.world.cell_m:g}: robots would see from another landmark than they stand at"
        )
