"""What one motion's frame takes on the uplink."""

from __future__ import annotations

from jouleswarm.common.scenario.sections import ExperienceCodec


def experience_bytes(codec: ExperienceCodec, camera: tuple[int, int], network: tuple[int, int]) -> int | None:
    """Bytes of one motion's frame, header apart; None where it depends on the picture (png).

    Args:
        camera, network: (width, height) of the camera's frame and of the network's input, pixels of 4 bytes.
    """
    if codec == "png":
        return None
    width, height = camera if codec == "raw" else network
    return 4 * width * height
