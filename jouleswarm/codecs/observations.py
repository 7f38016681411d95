"""One motion's observation on the uplink, through the scenario's codec of experience: arrays in place of weights.

Each message is whole. The data center learns from images at the network's size: those that come larger are shrunk here.
"""

from __future__ import annotations

import numpy as np

from jouleswarm.codecs.codec import Codec, open_codec
from jouleswarm.codecs.frames import shrink
from jouleswarm.codecs.models import called, encoded
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.messages import MOTION_METADATA_BYTES, RAW, MotionHeader
from jouleswarm.common.wire.tensorfile import decode_tensors, encode_tensors, layout_bytes, tensor_bytes
from jouleswarm.common.wire.types import Array, Layout, Payload

FRAME = "frame"
"""Name of the array that a codec of experience is given."""


def experience_codec_of(scenario: Scenario) -> Codec:
    """The scenario's codec of experience.

    Raises:
        ConfigurationError: it has none, or one that is not for its environment's observations.
    """
    return open_codec(scenario.meta.experience_codec, scenario)


def experience_bytes(codec: Codec, shown: Observation) -> int | None:
    """Bytes of one motion's observation on the uplink, header apart; None where they vary."""
    layout = codec.layout({FRAME: shown.shape}, True)
    return None if _varying(layout) else layout_bytes(layout)


def encode_experience(observation: Array, header: MotionHeader, codec: Codec) -> bytes:
    """A motion as its payload; `observation`: as the environment shows it."""
    if codec.name != RAW:
        header = header.model_copy(update={"codec": codec.name})
    return encode_tensors(encoded(codec, {FRAME: np.asarray(observation)}, None), header, MOTION_METADATA_BYTES)


def decode_experience(
    payload: Payload, codec: Codec, shown: Observation, kept: Observation
) -> tuple[Array, MotionHeader]:
    """A motion and its observation as a replay memory keeps it.

    Args:
        shown, kept: what the environment shows, and what is kept of it.

    Raises:
        PayloadError: not a motion of this codec and such an observation.
    """
    observation, header = decode_observation(payload, codec, shown, kept)
    return shrink(observation, kept), header


def decode_observation(
    payload: Payload, codec: Codec, shown: Observation, kept: Observation
) -> tuple[Array, MotionHeader]:
    """As `decode_experience`, with the observation as the codec gives it: as `shown` or as `kept`."""
    shapes = {FRAME: shown.shape}
    layout = _as_long_as(payload, codec.layout(shapes, True), 2 * shown.nbytes + 4096)
    tensors, header = decode_tensors(payload, [layout], MotionHeader, "motion")
    try:
        if (header.codec or RAW) != codec.name:
            raise PayloadError(f"{header.codec or RAW}, expected {codec.name}")
        if hasattr(codec, "check"):
            called(codec, "check", tensors, shapes)
        found = called(codec, "decode", tensors, shapes, None)
        observation = np.asarray(found[FRAME] if isinstance(found, dict) and FRAME in found else None)
        expected = kept if observation.shape == kept.shape else shown
        if observation.dtype != expected.dtype:
            raise PayloadError(f"an observation of {observation.dtype}, expected {expected}")
        if reason := expected.misfit(observation):
            raise PayloadError(f"an observation {reason}, expected {expected}")
    except PayloadError as error:
        raise PayloadError(f"motion of robot {header.agent}: {error}") from error
    return observation, header


def _varying(layout: Layout) -> str | None:
    """The tensor whose size is up to the observation, if there is one."""
    return next((name for name, (_, shape) in layout.items() if -1 in shape), None)


def _as_long_as(payload: Payload, layout: Layout, limit: int) -> Layout:
    """A layout with the size that varies as this payload has it.

    Raises:
        PayloadError: it cannot be so long, or is longer than `limit` bytes.
    """
    if (varying := _varying(layout)) is None:
        return layout
    code, shape = layout[varying]
    rest, unit = {**layout, varying: (code, (0,))}, {varying: (code, tuple(map(abs, shape)))}
    left, entry = tensor_bytes(payload) - layout_bytes(rest), layout_bytes(unit)
    if not 0 <= left <= limit or left % entry:
        raise PayloadError(f"motion: {left} bytes of {varying}, expected up to {limit}, a multiple of {entry}")
    return {**layout, varying: (code, tuple(left // entry if size < 0 else size for size in shape))}
