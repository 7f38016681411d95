"""Motions as the data center keeps them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.bus import Payload
from common.experience import decode_experience
from common.payloads import MotionHeader
from common.replay import Replay
from common.scenario import Scenario


@dataclass(frozen=True)
class Motion:
    """One motion: the frame at the network's size, uint8 [height, width, 4], and what the payload weighed."""

    frame: npt.NDArray[np.uint8]
    header: MotionHeader
    payload_bytes: int = 0


def read_motion(payload: Payload, scenario: Scenario) -> Motion:
    """A motion from the uplink.

    Raises:
        PayloadError: it is none of this scenario's frame size and codec.
    """
    camera, network = scenario.camera, scenario.network
    codec, sizes = scenario.meta.experience_codec, ((camera.width, camera.height), (network.width, network.height))
    frame, header = decode_experience(payload, codec, *sizes)
    return Motion(frame, header, len(payload))


def remember(replay: Replay, motions: Sequence[Motion]) -> None:
    """Put one robot's motions of one round into a replay memory."""
    for index, motion in enumerate(motions):
        header = motion.header
        replay.observe(motion.frame, first=header.first or index == 0)
        replay.act(header.action, header.reward, terminated=header.terminated)
