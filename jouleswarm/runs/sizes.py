"""What a scenario's rounds should compute and move, from its settings alone, to hold measurements against."""

from __future__ import annotations

from collections.abc import Mapping

from jouleswarm.codecs.codec import Codec, codec_of
from jouleswarm.codecs.experience import experience_bytes
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Network
from jouleswarm.common.wire.tensorfile import layout_bytes
from jouleswarm.common.wire.types import Shapes
from jouleswarm.energy.equations import RoundSizes, StageCounts
from jouleswarm.learning.heads import meta_shapes

_CHANNELS = 4  # a frame is RGB and depth, uint8
_ACTIONS = 4


def scenario_sizes(scenario: Scenario) -> RoundSizes:
    """What a round of this scenario computes and moves, from its settings alone: frames and weights as encoded."""
    camera, network, codec = scenario.camera, scenario.network, codec_of(scenario)
    raw, sent = ((camera.width, camera.height), (network.width, network.height)), scenario.meta.experience_codec
    # How far png compresses depends on the pictures: the closed form then has the raw frame.
    frame_bytes = experience_bytes(sent, *raw) or experience_bytes("raw", *raw) or 0
    model, learning = model_shapes(network), scenario.learning
    return RoundSizes(
        support_batches=scenario.meta.support_batches,
        query_batches=scenario.meta.query_batches,
        robot_batches=learning.batches_per_round,
        experience_bytes=learning.motions_per_round * frame_bytes,
        batches_of={agent: scenario.batches(agent) for agent in scenario.agents},
        experience_of={agent: scenario.motions(agent) * frame_bytes for agent in scenario.agents},
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
    """Closed form of an arm by its method's name (see `methods.method.Method.closed_form`); `sizes` are of a round:
    `scenario_sizes`, or the paper's `TABLE_I`."""
    found: StageCounts = scenario.method(method).closed_form(scenario, t0, rounds, sizes)
    return found


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
