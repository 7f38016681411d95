"""What a scenario's rounds should compute and move, from its settings alone, to hold measurements against."""

from __future__ import annotations

from collections.abc import Mapping

from common.energy import ClusterRounds, Counts, RoundSizes, StageCounts, closed_form, directed_links
from common.methods import META_METHODS
from common.scenario import Scenario
from common.settings import Network

_CHANNELS = 4  # a frame is RGB and depth, uint8
_ACTIONS = 4
_FLOAT32_BYTES = 4


def scenario_sizes(scenario: Scenario) -> RoundSizes:
    """What a round of this scenario computes and moves, from its settings alone: frames and float32 weights."""
    frame_bytes = scenario.camera.width * scenario.camera.height * _CHANNELS
    return RoundSizes(
        support_batches=scenario.meta.support_batches,
        query_batches=scenario.meta.query_batches,
        robot_batches=scenario.learning.batches_per_round,
        experience_bytes=scenario.learning.motions_per_round * frame_bytes,
        weights_bytes=_parameters(scenario.network) * _FLOAT32_BYTES,
    )


def expected_counts(
    scenario: Scenario, method: str, t0: float, rounds: Mapping[int, float], sizes: RoundSizes
) -> StageCounts:
    """Closed form of an arm, eqs. (9) and (11) and their like.

    - fl and what follows meta-learning: sum of t_i x robots x B_i gradients, t_i x directed links x b(W);
    - isolated: the gradients alone;
    - fedavg: the gradients, t_i x robots x b(W) up and as much down;
    - centralized: t_i x robots x B_i gradients in the data center, t_i x robots x b(E) up and x b(W) down.

    Args:
        method: the arm's method; every meta-learning method is taken to compute MAML's batches in its rounds.
        t0: rounds of meta-learning, 0 without.
        rounds: t_i by task id, the mean over its robots where each stops by itself.
        sizes: of a round; `scenario_sizes`, or the paper's `TABLE_I`.
    """
    if method in META_METHODS or method == "fl":
        clusters = []
        for task, task_rounds in rounds.items():
            robots = len(scenario.cluster(task))
            clusters.append(ClusterRounds(task_rounds, robots, directed_links(robots, scenario.federation)))
        training_robots = sum(len(agents) for agents in scenario.training_agents.values()) if t0 else 0
        return closed_form(t0, training_robots, clusters, sizes)
    robot_rounds = sum(task_rounds * len(scenario.cluster(task)) for task, task_rounds in rounds.items())
    gradients, weights_bytes = robot_rounds * sizes.robot_batches, robot_rounds * sizes.weights_bytes
    if method == "isolated":
        tasks = Counts(gradients_robots=gradients)
    elif method == "fedavg":
        tasks = Counts(gradients_robots=gradients, uplink_bytes=weights_bytes, downlink_bytes=weights_bytes)
    else:
        experience_bytes = robot_rounds * sizes.experience_bytes
        tasks = Counts(gradients_support=gradients, uplink_bytes=experience_bytes, downlink_bytes=weights_bytes)
    return StageCounts(fl=tasks)


def _parameters(network: Network) -> int:
    """Trainable parameters of the Q-network, counted without building it: a report needs no torch."""
    total, channels, height, width = 0, _CHANNELS, network.height, network.width
    for out, kernel, stride in network.conv:
        total += out * (channels * kernel * kernel + 1)
        channels, height, width = out, (height - kernel) // stride + 1, (width - kernel) // stride + 1
    features = channels * height * width
    for size in (*network.dense, _ACTIONS):
        total += size * (features + 1)
        features = size
    return total
