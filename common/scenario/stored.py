"""A scenario that an earlier version wrote down, resolved: what it meant where settings have come since. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

EARLIER: Mapping[str, Mapping[str, Any]] = {"federation": {"window": "partial"}, "learning": {"collect": "own"}}
"""Table -> settings that written scenarios may lack -> how it was before there was a choice."""


def as_written(data: Mapping[str, Any], factory: Any | None) -> dict[str, Any]:
    """A written scenario's data with the settings that it lacks as they were: a default of today may differ.

    Args:
        data: of a run's manifest or a study's record, where each table is whole.
        factory: of its environment; its `earlier` is as `EARLIER`, for its own tables.
    """
    found = dict(data)
    for name, fields in (*EARLIER.items(), *getattr(factory, "earlier", {}).items()):
        if isinstance(held := found.get(name), Mapping):
            found[name] = {**fields, **held}
    return found
