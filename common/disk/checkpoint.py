"""What a process goes on from, part by part, and the rows and counters that each part relies on."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jouleswarm.common.bus.reporter import HANDED_IN
from jouleswarm.common.disk.files import sync
from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.lock import LOCK
from jouleswarm.common.disk.seals import Growing, Seal
from jouleswarm.common.disk.state import State, Stateful
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.disk.verify import ROWS
from jouleswarm.common.errors import RunError
from jouleswarm.common.host import PROCESSOR
from jouleswarm.common.meter.counters import KEYS
from jouleswarm.common.scenario.scenario import Scenario

_PLACE = "place"


def owner_of(scenario: Scenario, run: str, whose: object) -> str:
    """Of all that a state depends on: it goes on bit by bit only where this is the same."""
    return hashlib.sha256(f"{run} {whose} {scenario.determines}".encode()).hexdigest()


class States:
    """States in a folder, one a part, each replaced whole or not at all; without a folder nothing is kept.

    The rows and counters beside them are found as they were, or a state is refused.
    """

    def __init__(self, folder: Path | None, owner: str, beside: Path | None = None, *, durable: bool = False) -> None:
        """
        Args:
            folder: for the states; made if need be.
            owner: see `owner_of`.
            beside: folder of rows and counters; default the same.
            durable: see `common.disk.statefile.StateFile`.
        """
        self.folder, self._owner, self._durable = folder, owner, durable
        self._beside = beside or folder
        self._files: dict[str, StateFile] = {}
        self._growing: dict[str, Growing] = {}
        if folder is not None and self._beside is not None:
            folder.mkdir(parents=True, exist_ok=True)
            paths = (self._beside / name for name in (ROWS, KEYS))
            self._growing = {os.path.relpath(path, folder): Growing(path) for path in paths}

    def put(
        self,
        part: str,
        place: Mapping[str, Any],
        states: Mapping[str, State | Stateful],
        sealed: Mapping[str, Seal] | None = None,
    ) -> None:
        """Keep where `part` stands: its place in words, and states by name. `sealed`: other files that it relies on."""
        if self.folder is None:
            return
        if self._durable:
            for frames in self.folder.glob("*.bin"):
                sync(frames)
        files = {name: growing.seal() for name, growing in self._growing.items()} | dict(sealed or {})
        self._file(part).save(State.of({**states, _PLACE: State(values=dict(place), files=files)}))

    def get(self, part: str, told: Callable[[Mapping[str, Any]], bool] = lambda row: False) -> State | None:
        """What was put last; None if nothing was. `told`: of a row, whether a state was put before it.

        Raises:
            RunError: it is another owner's, damaged, or gone though rows tell of it.
        """
        state = self._file(part).load() if self.folder is not None else None
        if state is None and self._has(told):
            raise RunError(f"{self.folder}: the state is gone, though rows of it are there; begin the run anew")
        return state

    def _has(self, told: Callable[[Mapping[str, Any]], bool]) -> bool:
        path = self._beside and self._beside / ROWS
        try:
            return path is not None and any(told(json.loads(line)) for line in whole_lines(path, mend=False))
        except (ValueError, KeyError, TypeError) as error:
            raise RunError(f"{path}: not as it was written; begin the run anew") from error

    def _file(self, part: str) -> StateFile:
        assert self.folder is not None
        if part not in self._files:
            self._files[part] = StateFile(self.folder / part, self._owner, durable=self._durable)
        return self._files[part]


def place_of(state: State) -> dict[str, Any]:
    """The place that a state was put with."""
    return state.part(_PLACE).values


def clear(folder: Path, *own: str) -> None:
    """Leave no trace in a process's folder; `own`: which files it has beside those that each has."""
    for path in (
        path for each in (*own, ROWS, "counters*", f"*{HANDED_IN}", PROCESSOR, LOCK) for path in folder.glob(each)
    ):
        path.unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # somebody else's files are in it, or a volume is mounted there
        folder.rmdir()
