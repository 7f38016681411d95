"""A run directory of either kind: what was learned and metered here, or what a meter counted of anybody's."""

from __future__ import annotations

from pathlib import Path

from jouleswarm.metering.metered import Metered, is_metered, load_metered
from jouleswarm.runs.run import Run, load_run


def load(path: str | Path) -> Run | Metered:
    """Read a run directory, also of what was cut short or goes on still.

    Raises:
        ConfigurationError: no such directory.
        RunError: it is none of these, or damaged.
    """
    return load_metered(Path(path)) if is_metered(Path(path)) else load_run(path)
