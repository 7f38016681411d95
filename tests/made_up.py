"""Networks and observations for tests that need no environment: landmarks' frames, four actions."""

from __future__ import annotations

from jouleswarm.codecs.observations import decode_experience
from jouleswarm.codecs.raw import Raw
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Network
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.messages import MOTION_METADATA_BYTES, MotionHeader
from jouleswarm.common.wire.tensorfile import encode_tensors
from jouleswarm.common.wire.types import Array, Payload
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.learning.qnetwork import QNetwork


def with_network(network: Network) -> Scenario:
    """A scenario over landmarks with this network."""
    return scenario_from(
        {
            "name": "made-up",
            "methods": ["fl"],
            "world": {"rows": 2, "cols": 2},
            "network": network.model_dump(),
            "tasks": [{"id": 1, "map": "E*\n.X"}],
        },
        "made-up",
    )


def qnetwork(network: Network, seed: int | None = None) -> QNetwork:
    """The Q-network of such a scenario."""
    return build_qnetwork(with_network(network), seed)


def encode_motion(frame: Array, header: MotionHeader) -> bytes:
    """A motion as it goes up without a codec."""
    return encode_tensors({"frame": frame}, header, MOTION_METADATA_BYTES)


def decode_motion(payload: Payload, expected: Observation) -> tuple[Array, MotionHeader]:
    """Such a motion read back."""
    return decode_experience(payload, Raw(expected.dtype), expected, expected)


def image(height: int, width: int, channels: int = 4) -> Observation:
    """Pixels."""
    return Observation(shape=(height, width, channels), dtype="uint8")
