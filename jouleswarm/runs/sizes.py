"""What a scenario's rounds should compute and move, from its settings alone, to hold measurements against."""

from __future__ import annotations

from collections.abc import Mapping

from jouleswarm.codecs.codec import experience_bytes, weights_bytes
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Network
from jouleswarm.energy.equations import RoundSizes, StageCounts

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
    learning = scenario.learning
    return RoundSizes(
        support_batches=scenario.meta.support_batches,
        query_batches=scenario.meta.query_batches,
        robot_batches=learning.batches_per_round,
        experience_bytes=learning.motions_per_round * frame_bytes,
        batches_of={agent: scenario.batches(agent) for agent in scenario.agents},
        experience_of={agent: scenario.motions(agent) * frame_bytes for agent in scenario.agents},
        weights_bytes=weights_bytes(codec, tensors),
        first_weights_bytes=weights_bytes(codec, tensors, whole=True),
        meta_model_bytes=weights_bytes(codec, [*tensors, *heads], whole=True),
    )


def expected_counts(
    scenario: Scenario, method: str, t0: float, rounds: Mapping[int, float], sizes: RoundSizes
) -> StageCounts:
    """Closed form of an arm by its method's name (see `methods.method.Method.closed_form`); `sizes` are of a round:
    `scenario_sizes`, or the paper's `TABLE_I`."""
    found: StageCounts = scenario.method(method).closed_form(scenario, t0, rounds, sizes)
    return found


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
