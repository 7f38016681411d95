"""JouleSwarm from Python: `from jouleswarm import run, Run`. What is named here is loaded when it is asked for.

docs/architecture.md shows the rooms of the house.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jouleswarm.api import Run as Run
    from jouleswarm.api import bill as bill
    from jouleswarm.api import run as run
    from jouleswarm.common.meter.loop import Meter as Meter
    from jouleswarm.energy.literal import literal as literal
    from jouleswarm.learning.qnetwork import QNetwork as QNetwork
    from jouleswarm.methods.method import Method as Method

_HOMES = {
    "bill": "jouleswarm.api",
    "run": "jouleswarm.api",
    "Run": "jouleswarm.api",
    "Meter": "jouleswarm.common.meter.loop",
    "Method": "jouleswarm.methods.method",
    "QNetwork": "jouleswarm.learning.qnetwork",
    "literal": "jouleswarm.energy.literal",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
