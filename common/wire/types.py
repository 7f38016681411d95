"""What goes around between the rooms, each type named once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Payload = bytes | bytearray | memoryview
"""What an MQTT message carries."""
Array = npt.NDArray[Any]
Weights = dict[str, npt.NDArray[np.float32]]
"""A model: its tensors by name, in the order of the network."""
Tensors = dict[str, Array]
"""What a codec makes of a model, by the names on the wire."""
Shapes = Mapping[str, tuple[int, ...]]
"""Tensor name -> shape of a model."""
Layout = Mapping[str, tuple[str, tuple[int, ...]]]
"""Tensor name -> safetensors dtype and shape on the wire, in the order of the file."""


class RowPhase:
    """How rows, counters and topics spell the phases: files that users read keep their words."""

    ML: Final = "maml"
    """The stage that the data center trains before, by whatever method."""
    FL: Final = "fl"
    """All other learning."""
