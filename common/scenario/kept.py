"""Scenarios that runs and studies have kept, each field with its value: what they meant before there was a field."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_BEFORE: dict[str, dict[str, Any]] = {"learning": {"collect": "own"}}
"""Fields whose default is not what was done before there were any."""


def as_kept(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """A scenario's data with fields that are newer than it at what was done then; the data stay as they are."""
    data = dict(scenario)
    for section, before in _BEFORE.items():
        if isinstance(held := data.get(section, {}), Mapping):
            data[section] = {**before, **held}
    return data
