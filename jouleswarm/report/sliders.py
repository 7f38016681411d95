"""The constants that a reader may move on a page: from a tenth to ten times the run's own, or an intensity."""

from __future__ import annotations

import re
from typing import NamedTuple


class Slider(NamedTuple):
    """A constant that is moved. Its position is a power of ten on the run's own value, or the value itself."""

    key: str
    """Of the scenario's section energy."""
    name: str
    """As the paper has it; what follows a `_` is its index."""
    meaning: str
    unit: str
    per_unit: float = 1.0
    """What a unit is in the scenario's own."""
    is_factor: bool = True
    follows: str = ""
    """The key whose value it has as long as it has none of its own."""

    @property
    def symbol(self) -> str:
        """The name as HTML."""
        return re.sub(r"_(\w+)", r"<sub>\1</sub>", self.name)


UPLINK = Slider("ul_bit_per_j", "E_UL", "uplink efficiency", "kb/J", 1e3)
SIDELINK = Slider("sl_bit_per_j", "E_SL", "sidelink efficiency", "kb/J", 1e3)
DOWNLINK = Slider("dl_bit_per_j", "E_DL", "downlink efficiency", "kb/J", 1e3, follows=UPLINK.key)
SLIDERS = (
    UPLINK,
    SIDELINK,
    Slider("p0_w", "P_0", "data center power", "W"),
    Slider("t0_batch_s", "T_0", "data center time of a batch gradient", "ms", 1e-3),
    Slider("pk_w", "P_k", "robot power", "W"),
    Slider("tk_batch_s", "T_k", "robot time of a batch gradient", "ms", 1e-3),
    Slider("datacenter_g_per_kwh", "carbon, data center", "carbon intensity of its electricity", "g/kWh", 1, False),
    Slider("robots_g_per_kwh", "carbon, robots", "carbon intensity where they are charged", "g/kWh", 1, False),
)
LINK_SLIDERS = (UPLINK, DOWNLINK, SIDELINK)
"""Of what was moved and nothing else."""
