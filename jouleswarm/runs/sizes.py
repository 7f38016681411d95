"""What a scenario's rounds should compute and move, from its settings alone, to hold measurements against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from jouleswarm.codecs.codec import experience_bytes, weights_bytes
from jouleswarm.common.scenario.arms import META_METHODS
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Network
from jouleswarm.energy.closed_form import ClusterRounds, RoundSizes, closed_form, directed_links
from jouleswarm.energy.facts import Counts, StageCounts

_CHANNELS = 4  # a frame is RGB and depth, uint8
_ACTIONS = 4


def scenario_sizes(scenario: Scenario) -> RoundSizes:
    """What a round of this scenario computes and moves, from its settings alone: frames and weights as encoded."""
    camera, network, codec = scenario.camera, scenario.network, scenario.federation.weights_codec
    raw, sent = ((camera.width, camera.height), (network.width, network.height)), scenario.meta.experience_codec
    # How far png compresses depends on the pictures: the closed form then has the raw frame.
    frame_bytes = experience_bytes(sent, *raw) or experience_bytes("raw", *raw) or 0
    tensors = tensor_entries(network)
    heads = tensors[-2:] * (len(scenario.meta.training_tasks) if scenario.meta.heads == "per_task" else 0)
    return RoundSizes(
        support_batches=scenario.meta.support_batches,
        query_batches=scenario.meta.query_batches,
        robot_batches=scenario.learning.batches_per_round,
        experience_bytes=scenario.learning.motions_per_round * frame_bytes,
        weights_bytes=weights_bytes(codec, tensors),
        first_weights_bytes=weights_bytes(codec, tensors, whole=True),
        meta_model_bytes=weights_bytes(codec, [*tensors, *heads], whole=True),
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
        return _by_kind(closed_form(t0, training_robots, clusters, sizes), method)
    # A served cluster's first weights have no base either, up or down.
    robot_rounds = sum(task_rounds * len(scenario.cluster(task)) for task, task_rounds in rounds.items())
    robots = sum(len(scenario.cluster(task)) for task, task_rounds in rounds.items() if task_rounds)
    gradients, models_bytes = (
        robot_rounds * sizes.robot_batches,
        robot_rounds * sizes.weights_bytes + robots * sizes.base_bytes,
    )
    if method == "isolated":
        tasks = Counts(gradients_robots=gradients)
    elif method == "fedavg":
        tasks = Counts(gradients_robots=gradients, uplink_bytes=models_bytes, downlink_bytes=models_bytes)
    else:
        frames_bytes = robot_rounds * sizes.experience_bytes
        tasks = Counts(gradients_support=gradients, uplink_bytes=frames_bytes, downlink_bytes=models_bytes)
    return StageCounts(fl=tasks)


def _by_kind(counts: StageCounts, method: str) -> StageCounts:
    """Reptile and joint training have no query batches: all of a round's gradients are plain ones."""
    if method not in ("reptile", "multitask"):
        return counts
    every = counts.ml.gradients_support + counts.ml.gradients_query
    return StageCounts(replace(counts.ml, gradients_support=every, gradients_query=0), counts.fl)


def tensor_entries(network: Network) -> list[int]:
    """Entries of each of the Q-network's tensors, counted without building it: a report needs no torch."""
    entries, channels, height, width = [], _CHANNELS, network.height, network.width
    for out, kernel, stride in network.conv:
        entries += [out * channels * kernel * kernel, out]
        channels, height, width = out, (height - kernel) // stride + 1, (width - kernel) // stride + 1
    features = channels * height * width
    for size in (*network.dense, _ACTIONS):
        entries += [size * features, size]
        features = size
    return entries
