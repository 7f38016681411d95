"""What a scenario's rounds should compute and move, from its settings alone, to hold counts against."""

from __future__ import annotations

from collections.abc import Mapping

from jouleswarm.codecs.codec import Codec, codec_of
from jouleswarm.codecs.observations import experience_bytes, experience_codec_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Interface
from jouleswarm.common.wire.tensorfile import layout_bytes
from jouleswarm.common.wire.types import Shapes
from jouleswarm.energy.closed_form import RoundSizes
from jouleswarm.energy.facts import StageCounts
from jouleswarm.learning.heads import meta_shapes
from jouleswarm.runs.interface import interface_of


def scenario_sizes(scenario: Scenario) -> RoundSizes:
    """What a round of this scenario computes and moves: observations and weights as encoded."""
    interface, codec, learning = interface_of(scenario), codec_of(scenario), scenario.learning
    observation, model = interface.spaces.observation, model_shapes(interface)
    # How far some codecs compress depends on what is seen: the closed form then has the raw observation.
    sent = experience_bytes(experience_codec_of(scenario), observation)
    frame_bytes = observation.nbytes if sent is None else sent
    return RoundSizes(
        support_batches=scenario.meta.support_batches,
        query_batches=scenario.meta.query_batches,
        robot_batches=learning.batches_per_round,
        experience_bytes=learning.motions_per_round * frame_bytes,
        batches_of={agent: scenario.batches(agent) for agent in scenario.agents},
        experience_of={agent: scenario.motions(agent) * frame_bytes for agent in scenario.agents},
        weights_bytes=weights_bytes(codec, model, whole=False),
        first_weights_bytes=weights_bytes(codec, model, whole=True),
        meta_model_of={
            name: weights_bytes(codec, meta_model_shapes(interface, scenario, name), whole=True)
            for name in scenario.meta_methods
        },
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


def model_shapes(interface: Interface) -> dict[str, tuple[int, ...]]:
    """The Q-network's tensors, in their order."""
    return dict(interface.tensors)


def meta_model_shapes(interface: Interface, scenario: Scenario, method: str) -> dict[str, tuple[int, ...]]:
    """A method's meta-model: the network's tensors, and a last layer for each task that has one of its own."""
    shapes = model_shapes(interface)
    head = list(shapes)[len(shapes) - interface.head :]
    return meta_shapes(shapes, head, scenario.method(method).heads(scenario))
