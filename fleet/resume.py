"""What a run must still have to be gone on with."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from common.errors import ConfigurationError
from common.lines import whole_lines
from common.runlog import MANIFEST, ROUNDS, STATE
from fleet.admission import client_of


def check_states(path: Path) -> None:
    """Whoever has told a round has a folder of its state: without it the others would wait for its old rounds.

    Raises:
        ConfigurationError: one is missing, or there is nothing in it.
    """
    told = sorted(set(_told(path / ROUNDS)))
    names = [client_of(agent) for agent in told]
    if told and json.loads((path / MANIFEST).read_text(encoding="utf-8")).get("broker", {}).get("embedded"):
        names.append("broker")
    for name in names:
        if not any((path / STATE / name).glob("*")):
            raise ConfigurationError(
                f"run {path}: {STATE}/{name} is missing or empty, and rounds have been told of already; it cannot be "
                "gone on with: put that folder back, or run the scenario again"
            )


def _told(rows: Path) -> Iterator[int]:
    """Whose rows there are; what cannot be read is for who reads them all."""
    for line in whole_lines(rows, mend=False):
        try:
            yield int(json.loads(line)["agent"])
        except (ValueError, KeyError, TypeError):
            continue
