"""The run directory: what a run leaves behind, written as it happens.

``manifest.json``   scenario resolved, seed, versions, host
``rounds.jsonl``    one row a robot and round; agent 0 is the data center
``meter.jsonl``     cumulative byte counters, both sides of the bus
``work.jsonl``      gradients and motions that each process has done, kept or not
``progress.jsonl``  payload bytes received so far by link class, over time
``summary.json``    rounds, rewards, joules and bytes of each arm
``weights/``        learned weights and meta-models as safetensors
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from common.bus import Payload
from common.errors import ConfigurationError
from common.lines import whole_lines
from common.meter import MeterRow
from common.state import write_whole
from common.work import WorkRow

STATE = "state"
"""Folder of what a run that was interrupted is gone on from; a complete run has none."""

MANIFEST, ROUNDS, METER, WORK, PROGRESS, SUMMARY = (
    "manifest.json",
    "rounds.jsonl",
    "meter.jsonl",
    "work.jsonl",
    "progress.jsonl",
    "summary.json",
)


class RoundRow(BaseModel):
    """One robot's round (or, agent 0, one training task of the data center's MAML round)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    phase: Literal["maml", "fl"]
    """maml: the meta-learning stage in the data center, by whatever method. fl: everything else."""
    arm: str
    task: int
    agent: int
    round: int
    reward: float | None = None
    """Discounted return of the robot's greedy episode from the entry."""
    cluster_reward: float | None = None
    """R, which decides whether the task is learned: see agents/neighbourhood.py."""
    rmse_m: float | None = None
    gradients: int = 0
    """Batch gradients really computed; of the data center support + query."""
    gradients_support: int | None = None
    gradients_query: int | None = None
    beta: float | None = None
    """Cost of an exact meta-gradient over a first-order one, where the data center measured it."""
    experience_bytes: int | None = None
    """Payload bytes of raw observations that the data center's round was learned from."""
    learned: bool | None = None
    """On a robot's last row of an arm: whether R reached the target."""
    missed: tuple[int, ...] = ()
    """Neighbours without whom the robot went on (federation.on_missing = "proceed")."""
    refused: int = 0
    """Payloads refused so far."""
    seconds: float

    def sort_key(self) -> tuple[str, str, int, int, int]:
        """Order of the finished file, whatever the order of arrival."""
        return self.arm, {"maml": "0"}.get(self.phase, "1"), self.task, self.agent, self.round


class RunDirectory:
    """Append-only writer of one run. Lines are whole on disk before the next one is begun."""

    def __init__(self, path: Path, *, resume: bool = False) -> None:
        """Make the directory, or go on with one.

        Raises:
            ConfigurationError: it exists and is not empty (nothing is ever written over), or is none to go on with.
        """
        if resume and not (path / MANIFEST).exists():
            raise ConfigurationError(f"run directory {path}: has no {MANIFEST}; name one that `jouleswarm run` printed")
        if not resume and path.exists() and any(path.iterdir()):
            raise ConfigurationError(f"run directory {path} is not empty; name another with --out or --run-id")
        self.path = path
        self._told: dict[tuple[object, ...], bytearray] = {}  # whose rows: by round, whether it is there
        if resume:
            whole_lines(path / ROUNDS)
            whole_lines(path / PROGRESS)
            for name in (METER, WORK, SUMMARY):  # of a run that was interrupted
                (path / name).unlink(missing_ok=True)
            for row in self._each_row():
                self._book(row)
        (path / "weights").mkdir(parents=True, exist_ok=True)

    def manifest(self, manifest: dict[str, Any]) -> None:
        """Write the manifest."""
        self._replace(MANIFEST, json.dumps(manifest, indent=2) + "\n")

    def round(self, row: RoundRow) -> None:
        """Append a row; one that is there already, told again by a process that was killed, is left out.

        So is one that comes late: `complete` brings it.
        """
        if row.round >= len(self._told.get(_whose(row), b"")) and self._book(row):
            self._append(ROUNDS, row.model_dump_json(exclude_none=False))

    def complete(self, rows: Iterable[RoundRow]) -> None:
        """Append those of a process's rows that have not come."""
        for row in rows:
            if self._book(row):
                self._append(ROUNDS, row.model_dump_json(exclude_none=False))

    def _book(self, row: RoundRow) -> bool:
        """Whether a row is not there yet."""
        there = self._told.setdefault(_whose(row), bytearray())
        there.extend(bytes(max(0, row.round + 1 - len(there))))
        is_new, there[row.round] = not there[row.round], 1
        return is_new

    def progress(self, row: dict[str, Any]) -> None:
        """Append a point of the byte curves."""
        self._append(PROGRESS, json.dumps(row))

    def meter(self, rows: Iterable[MeterRow]) -> None:
        """Write the final counters."""
        self._replace(METER, "".join(row.model_dump_json() + "\n" for row in rows))

    def work(self, rows: Iterable[WorkRow]) -> None:
        """Write what the processes have done."""
        self._replace(WORK, "".join(row.model_dump_json() + "\n" for row in rows))

    def summary(self, summary: dict[str, Any]) -> None:
        """Write the summary, and the rows in their final order."""
        ordered = sorted(self.rows, key=RoundRow.sort_key)
        self._replace(ROUNDS, "".join(row.model_dump_json() + "\n" for row in ordered))
        self._replace(SUMMARY, json.dumps(summary, indent=2) + "\n")

    def weights(self, name: str, payload: Payload) -> None:
        """Keep a model, as it came from the bus, as weights/<name>.safetensors."""
        path = self.path / "weights" / f"{name}.safetensors"
        write_whole(path, payload)

    @property
    def rows(self) -> list[RoundRow]:
        """Rows written so far, in order of arrival; read again, so that memory does not grow with the rounds."""
        return list(self._each_row())

    def _each_row(self) -> Iterator[RoundRow]:
        path = self.path / ROUNDS
        if path.exists():
            with path.open(encoding="utf-8") as file:
                yield from map(RoundRow.model_validate_json, file)

    def _append(self, name: str, line: str) -> None:
        with (self.path / name).open("a", encoding="utf-8") as file:
            file.write(line + "\n")

    def _replace(self, name: str, text: str) -> None:
        write_whole(self.path / name, text.encode())


def _whose(row: RoundRow) -> tuple[object, ...]:
    return row.arm, row.phase, row.task, row.agent
