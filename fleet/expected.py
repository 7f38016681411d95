"""What a scenario's round should compute and move, from its settings alone, to hold measurements against."""

from __future__ import annotations

from collections.abc import Mapping

from common.energy import ClusterRounds, Counts, RoundSizes, closed_form, directed_links
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


def expected_counts(scenario: Scenario, t0: float, rounds: Mapping[int, float], sizes: RoundSizes) -> Counts:
    """Closed form of an arm, eqs. (9) and (11).

    Args:
        t0: MAML rounds, 0 in the arm without.
        rounds: t_i by task id.
        sizes: of a round; `scenario_sizes`, or the paper's `TABLE_I`.
    """
    clusters = []
    for task, task_rounds in rounds.items():
        robots = len(scenario.cluster(task))
        clusters.append(ClusterRounds(task_rounds, robots, directed_links(robots, scenario.federation)))
    training_robots = sum(len(agents) for agents in scenario.training_agents.values()) if t0 else 0
    return closed_form(t0, training_robots, clusters, sizes)


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
