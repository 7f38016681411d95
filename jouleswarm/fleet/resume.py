"""What a run must still have to be gone on with."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.lock import LOCK
from jouleswarm.common.disk.state import STATE_FILE
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.counters import KEYS
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.runs.directory import MANIFEST, ROUNDS, STATE


def check_is_there(path: Path) -> None:
    """Whoever has told a round has a folder of its state: without it the others would wait for its old rounds.

    Raises:
        ConfigurationError: one is missing, or what must be in it.
    """
    told = list(_told(path / ROUNDS))
    # A robot that has learned has written its state before.
    needed: dict[str, str | None] = {client_of(agent): None for agent, _ in told}
    needed |= {client_of(agent): f"{STATE_FILE}.0" for agent, phase in told if agent and phase == RowPhase.FL}
    if told and json.loads((path / MANIFEST).read_text(encoding="utf-8")).get("broker", {}).get("embedded"):
        needed["broker"] = KEYS
    for name, file in sorted(needed.items()):
        folder = path / STATE / name
        if not (folder / file).exists() if file else not any(each.name != LOCK for each in folder.glob("*")):
            what = f"{STATE}/{name}/{file}" if file and folder.exists() else f"{STATE}/{name}"
            raise ConfigurationError(
                f"run {path}: {what} is missing or empty, and rounds have been told of already; it cannot be gone on "
                "with: put it back, or run the scenario again"
            )


def _told(rows: Path) -> Iterator[tuple[int, str]]:
    """Whose rows of which phase there are; what cannot be read is for who reads them all."""
    for line in whole_lines(rows, mend=False):
        try:
            row = json.loads(line)
            yield int(row["agent"]), str(row["phase"])
        except (ValueError, KeyError, TypeError):
            continue
