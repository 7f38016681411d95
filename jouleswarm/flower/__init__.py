"""A meter for Flower apps: two lines, and a run leaves bytes by client and round, seconds and joules (docs/flower.md).

    app = ClientApp(mods=[meter_mod])       # client: what the app takes, told to the server with each reply
    strategy = metered(FedAvg(...))         # server: counts every message, and writes the run directory

Nothing is loaded but Flower, NumPy and the standard library, so that clients need no more of us.
"""

from __future__ import annotations

from jouleswarm.flower.client import MeterMod, gradients, meter_mod
from jouleswarm.flower.server import metered

__all__ = ["MeterMod", "gradients", "meter_mod", "metered"]
