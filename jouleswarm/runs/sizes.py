"""What a scenario's rounds should compute and move, from its settings alone, to hold measurements against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from jouleswarm.codecs.codec import Codec, codec_of
from jouleswarm.codecs.experience import experience_bytes
from jouleswarm.common.scenario.arms import META_METHODS
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Network
from jouleswarm.common.wire.tensorfile import layout_bytes
from jouleswarm.common.wire.types import Shapes
from jouleswarm.energy.equations import ClusterRounds, Counts, RoundSizes, StageCounts, closed_form, directed_links
from jouleswarm.learning.heads import meta_shapes

_CHANNELS = 4  # a frame is RGB and depth, uint8
_ACTIONS = 4


def scenario_sizes(scenario: Scenario) -> RoundSizes:
    """What a round of this scenario computes and moves, from its settings alone: frames and weights as encoded."""
    camera, network, codec = scenario.camera, scenario.network, codec_of(scenario)
    raw, sent = ((camera.width, camera.height), (network.width, network.height)), scenario.meta.experience_codec
    # How far png compresses depends on the pictures: the closed form then has the raw frame.
    frame_bytes = experience_bytes(sent, *raw) or experience_bytes("raw", *raw) or 0
    model = model_shapes(network)
    return RoundSizes(
        support_batches=scenario.meta.support_batches,
        query_batches=scenario.meta.query_batches,
        robot_batches=scenario.learning.batches_per_round,
        experience_bytes=scenario.learning.motions_per_round * frame_bytes,
        weights_bytes=weights_bytes(codec, model, whole=False),
        first_weights_bytes=weights_bytes(codec, model, whole=True),
        meta_model_bytes=weights_bytes(codec, meta_model_shapes(scenario), whole=True),
    )


def weights_bytes(codec: Codec, shapes: Shapes, *, whole: bool) -> int:
    """Bytes of a message's tensors, header apart; `whole`: without a base, as an arm's first and every meta-model."""
    return layout_bytes(codec.layout(shapes, whole))


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


def model_shapes(network: Network) -> dict[str, tuple[int, ...]]:
    """The Q-network's tensors, known without building it: a report needs no torch."""
    shapes: dict[str, tuple[int, ...]] = {}
    channels, height, width = _CHANNELS, network.height, network.width
    for place, (out, kernel, stride) in enumerate(network.conv):  # a ReLU after each
        shapes |= {f"{2 * place}.weight": (out, channels, kernel, kernel), f"{2 * place}.bias": (out,)}
        channels, height, width = out, (height - kernel) // stride + 1, (width - kernel) // stride + 1
    features, first = channels * height * width, 2 * len(network.conv) + 1  # after the Flatten
    for place, size in enumerate((*network.dense, _ACTIONS)):
        shapes |= {f"{first + 2 * place}.weight": (size, features), f"{first + 2 * place}.bias": (size,)}
        features = size
    return shapes


def meta_model_shapes(scenario: Scenario) -> dict[str, tuple[int, ...]]:
    """A meta-model's tensors: the network's, and a last layer for each training task that has one of its own."""
    shapes, meta = model_shapes(scenario.network), scenario.meta
    return meta_shapes(shapes, list(shapes)[-2:], meta.training_tasks if meta.heads == "per_task" else ())
