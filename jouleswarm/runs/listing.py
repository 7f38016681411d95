"""The runs in a folder, each at a glance, from few of its files: nothing is priced, nothing is loaded whole."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.lock import is_held
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.runs.directory import MANIFEST, ROUNDS, SUMMARY
from jouleswarm.runs.files import read_manifest, read_summary


@dataclass(frozen=True)
class ListedArm:
    """Of one arm what a list tells."""

    name: str
    rounds: int
    """Of all tasks together, so far."""
    joules: float | None
    """By the equations, at the run's own prices; None while the run is not over."""


@dataclass(frozen=True)
class ListedRun:
    """One run of a folder."""

    path: Path
    status: str
    """complete, interrupted, failed, running, or unreadable."""
    scenario: str = ""
    seed: int | None = None
    started: datetime | None = None
    arms: tuple[ListedArm, ...] = ()
    why: str = ""
    """It is not readable."""


def listed(folder: Path) -> list[ListedRun]:
    """Every run of a folder, the newest first; what is no run is left out.

    Raises:
        ConfigurationError: no such folder.
    """
    if not folder.is_dir():
        raise ConfigurationError(f"folder {folder}: no such folder; name one that runs were written to (--out)")
    found = [_listed(each.parent) for each in folder.glob(f"*/{MANIFEST}")]
    return sorted(found, key=lambda run: (-(run.started.timestamp() if run.started else 0), run.path.name))


def _listed(path: Path) -> ListedRun:
    try:
        manifest, summary = read_manifest(path), read_summary(path / SUMMARY)
        status = "interrupted" if summary is None else str(summary["status"])
        status = "running" if status != "complete" and is_held(path) else status
        started = datetime.fromisoformat(manifest["started"]).astimezone(UTC)
        if kind := manifest.get("kind"):  # a meter's, which has no arms of its own
            return ListedRun(path, status, scenario=str(kind), started=started)
        arms = _so_far(path / ROUNDS) if summary is None else _at_the_end(summary)
        return ListedRun(
            path=path,
            status=status,
            scenario=str(manifest["scenario"]["name"]),
            seed=int(manifest["seed"]),
            started=started,
            arms=tuple(arms),
        )
    except (RunError, OSError, ValueError, KeyError, TypeError) as error:
        return ListedRun(path, "unreadable", why=str(error))


def _at_the_end(summary: Mapping[str, Any]) -> Iterator[ListedArm]:
    for name, arm in summary["arms"].items():
        priced = arm["energy_j"]["literal"] or {}
        yield ListedArm(name, sum(task["rounds"] for task in arm["tasks"]), priced.get("total"))


def _so_far(file: Path) -> Iterator[ListedArm]:
    newest: dict[str, dict[int, int]] = {}
    for line in whole_lines(file, mend=False):
        row = json.loads(line)
        if row["phase"] == "fl" and row["agent"]:
            tasks = newest.setdefault(row["arm"], {})
            tasks[row["task"]] = max(tasks.get(row["task"], 0), row["round"])
    for name, tasks in newest.items():
        yield ListedArm(name, sum(tasks.values()), None)
