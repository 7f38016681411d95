"""The run directory: what a run leaves behind, written as it happens.

``manifest.json``   scenario resolved, seed, versions, host
``rounds.jsonl``    one row a robot and round; agent 0 is the data center
``meter.jsonl``     cumulative byte counters, both sides of the bus
``work.jsonl``      gradients and motions that each process has done, kept or not
``joules.jsonl``    joules that each process has measured of itself, of a run with ``measure.energy``
``progress.jsonl``  payload bytes received so far by link class, over time
``times.jsonl``     when each row came, by the recorder's clock
``summary.json``    rounds, rewards, joules and bytes of each arm
``doors/``          the user's own files, methods, edge lists, ... as they were
``weights/``        learned weights and meta-models as safetensors
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.lock import LOCK
from jouleswarm.common.disk.rowfile import RowFile
from jouleswarm.common.disk.seals import Seal
from jouleswarm.common.disk.state import State
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.disk.trouble import disk_error
from jouleswarm.common.doors import DOORS
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.joules import JoulesRow
from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import Payload

_COMPUTED_ON = "computed_on"
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
JOULES, TIMES = "joules.jsonl", "times.jsonl"
_SUMS, _SEALS = "rows.sums", "seals"


class RunDirectory:
    """Writer of one run. Lines are whole on disk before the next one is begun."""

    def __init__(self, path: Path, *, resume: bool = False, state: Path | None = None) -> None:
        """Make the directory, or go on with one; who does so holds its lock (see `common.disk.lock`).

        Args:
            path: of the directory.
            resume: go on with what is there.
            state: a folder for what tells, when the run is gone on with, that all is as it was written.

        Raises:
            ConfigurationError: it exists and is not empty (nothing is ever written over), or is none to go on with.
            RunError: it is to be gone on with, and a file is not as it was written.
        """
        if resume and not (path / MANIFEST).exists():
            raise ConfigurationError(f"run directory {path}: has no {MANIFEST}; name one that `jouleswarm run` printed")
        if not resume and path.exists() and any(each.name != LOCK for each in path.iterdir()):
            raise ConfigurationError(f"run directory {path} is not empty; name another with --out or --run-id")
        self.path, self._state = path, state
        self._rows = RowFile(path / ROUNDS, state and state / _SUMS)
        self._seals: dict[str, Seal] = {}
        # A model that was handed in is not handed in again: on the disk, as the model is.
        self._sealed = StateFile(state / _SEALS, str(STATE), durable=True) if state else None
        if state is not None:
            state.mkdir(parents=True, exist_ok=True)
        if resume:
            self._go_on()
        (path / "weights").mkdir(parents=True, exist_ok=True)

    def _go_on(self) -> None:
        if self._sealed is not None:
            sealed = self._sealed.load()
            if sealed is None and (self.path / ROUNDS).exists():
                raise RunError(f"{self._state}: what tells of the run's files is gone; begin the run anew")
            self._seals = sealed.files if sealed is not None else {}
        self._rows.go_on()
        for name in (PROGRESS, TIMES):
            whole_lines(self.path / name)
        for name in (METER, WORK, JOULES, SUMMARY):  # of a run that was interrupted
            (self.path / name).unlink(missing_ok=True)

    def doors(self, files: Mapping[str, Path]) -> None:
        """Keep the user's files that a scenario names, by their names: going on and reporting need nothing else."""
        for name, path in files.items():
            kept = self.path / DOORS / name
            if not kept.exists():
                kept.parent.mkdir(exist_ok=True)
                write_whole(kept, path.read_bytes())

    def manifest(self, manifest: dict[str, Any]) -> None:
        """Write the manifest."""
        self._keep(MANIFEST, (json.dumps(manifest, indent=2) + "\n").encode())

    def computed_on(self, client: str, processor: str) -> None:
        """Note in the manifest what a process computes on from here on."""
        manifest = json.loads((self.path / MANIFEST).read_text(encoding="utf-8"))
        noted = manifest.setdefault("host", {}).setdefault(_COMPUTED_ON, {}).setdefault(client, [])
        if noted[-1:] != [processor]:
            noted.append(processor)
            self.manifest(manifest)

    def round(self, row: RoundRow, time_s: float | None = None) -> None:
        """Append a row (see `RowFile.add`), and when it came, in seconds since 1970."""
        self._rows.add(row)
        if time_s is not None:
            whose = row.model_dump(include={"phase", "arm", "task", "agent", "round"})
            self._append(TIMES, {"time_s": round(time_s, 3), **whose})

    def begin_again(self, is_over: Callable[[RoundRow], bool]) -> None:
        """The rows that were the last ones of their robots are not, but those of which that `is_over` holds."""
        self._rows.amend(lambda row: row if is_over(row) else row.model_copy(update={"learned": None}))

    def complete(self, rows: Iterable[RoundRow]) -> None:
        """Append those of a process's rows that have not come or were lost."""
        self._rows.complete(rows)

    def lost_rows(self) -> str:
        """What of the rows written has been lost for good, in words; "" if nothing: then the run may be complete."""
        return self._rows.lost()

    def progress(self, row: dict[str, Any]) -> None:
        """Append a point of the byte curves."""
        self._append(PROGRESS, row)

    def meter(self, rows: Iterable[MeterRow]) -> None:
        """Write the final counters."""
        write_whole(self.path / METER, "".join(row.model_dump_json() + "\n" for row in rows).encode())

    def work(self, rows: Iterable[WorkRow]) -> None:
        """Write what the processes have done."""
        write_whole(self.path / WORK, "".join(row.model_dump_json() + "\n" for row in rows).encode())

    def joules(self, rows: Sequence[JoulesRow]) -> None:
        """Write what the processes have measured, if they have."""
        if rows:
            write_whole(self.path / JOULES, "".join(row.model_dump_json() + "\n" for row in rows).encode())

    def summary(self, summary: dict[str, Any]) -> None:
        """Write the summary, and the rows in their final order.

        Raises:
            RunError: a number in it is not finite, which JSON cannot say; nothing of the run is lost.
        """
        try:
            text = json.dumps(summary, indent=2, allow_nan=False)
        except ValueError as error:
            raise RunError(
                f"{self.path / SUMMARY}: a figure is not finite ({error}), expected finite ones; rows and counters are "
                "whole, see `jouleswarm report` with other prices"
            ) from error
        self._rows.sort()
        write_whole(self.path / SUMMARY, (text + "\n").encode())

    def weights(self, name: str, payload: Payload) -> None:
        """Keep a model, as it came from the bus, as weights/<name>.safetensors."""
        self._keep(f"weights/{name}.safetensors", payload)

    @property
    def rows(self) -> list[RoundRow]:
        """Rows written so far, in order of arrival."""
        return list(self._rows.rows())

    def _append(self, name: str, row: dict[str, Any]) -> None:
        try:
            with (self.path / name).open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        except OSError as error:
            raise disk_error(self.path / name, error) from error

    def _keep(self, name: str, content: Payload) -> None:
        """Write a file that a resumed run must find as it is."""
        if self._state is None or self._sealed is None:
            write_whole(self.path / name, content)
            return
        seal, beside = Seal.of(content), os.path.relpath(self.path / name, self._state)
        if (held := self._seals.get(beside)) is not None and not held.is_like(seal):
            # Whoever is killed before it is written finds the one before, or this one.
            del self._seals[beside]
            self._sealed.save(State(files=self._seals))
        write_whole(self.path / name, content)
        self._seals[beside] = seal
        self._sealed.save(State(files=self._seals))


def computed_on(manifest: dict[str, Any]) -> dict[str, list[str]]:
    """Client -> what it has computed on, one after the other, as a run's manifest has it (see `common.host`)."""
    noted: dict[str, list[str]] = (manifest.get("host") or {}).get(_COMPUTED_ON, {})
    return noted
