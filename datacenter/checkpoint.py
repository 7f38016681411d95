"""The data center's memory on disk: after each round enough to go on from there, bit by bit the same."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from jouleswarm.common.bus.reporter import HANDED_IN
from jouleswarm.common.disk.files import sync, write_whole
from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.lock import LOCK
from jouleswarm.common.disk.seals import Growing, Seal
from jouleswarm.common.disk.state import State, Stateful
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import RunError
from jouleswarm.common.host import PROCESSOR
from jouleswarm.common.meter.counters import KEYS
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow

_FINISHED = "finished"
_BESIDE = ("rounds.jsonl", KEYS)
"""Of the data center, in the folder above."""
_MODEL = "model-"


class Checkpoint:
    """One method's folder: a state for each part that learns by itself, replaced each round. None remembers nothing."""

    def __init__(
        self,
        folder: Path | None,
        owner: str = "",
        whose: tuple[str, str] = ("", ""),
        *,
        durable: bool = False,
        until: str | None = None,
    ) -> None:
        """
        Args:
            folder: for the states; None remembers nothing.
            owner: see `owner_of`.
            whose: phase and arm of its rows.
            durable: see `common.disk.state.StateFile`.
            until: when it is finished, in words: it goes on from its states where that is another time. None: it is
                finished for good, and forgets them.
        """
        self._whose, self._until = whose, until
        self.folder, self._owner, self._durable = folder, owner, durable
        self._files: dict[str, StateFile] = {}
        self._models: dict[str, Seal] = {}
        self._growing: dict[str, Growing] = {}
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            self._growing = {f"../{name}": Growing(folder.parent / name) for name in _BESIDE}

    def save(self, round_: int, state: State, part: str = "state") -> None:
        """Keep where `part` stands after `round_`; whole or not at all."""
        if self.folder is not None:
            if self._durable:
                for frames in self.folder.glob("*.bin"):
                    sync(frames)
            beside = {name: growing.seal() for name, growing in self._growing.items()}
            done = State(values={"round": round_}, files=beside | self._models)
            self._file(part).save(State.of({"learned": state, "done": done}))

    def load(self, part: str = "state") -> tuple[int, State] | None:
        """The last whole round of `part` and its state.

        Raises:
            RunError: the folder holds another scenario's, or it is damaged.
        """
        state = self._file(part).load() if self.folder is not None else None
        if state is None and self._has_told(part):
            raise RunError(f"{self.folder}: the state is gone, though rows of it are there; begin the run anew")
        if state is not None:
            self._models = {name: seal for name, seal in state.files.items() if name.startswith(_MODEL)}
        return None if state is None else (state.part("done").values["round"], state.part("learned"))

    def restore(self, learner: Stateful) -> int:
        """Bring `learner` to where the last whole round left it; returns that round, 0 without any.

        Raises:
            RunError: as `load`.
        """
        found = self.load()
        if found is None:
            return 0
        learner.load_state(found[1])
        return found[0]

    def keep_model(self, round_: int, payload: bytes) -> None:
        """Keep a meta-model that goes down when the stage is over."""
        if self.folder is not None:
            name = f"{_MODEL}{round_:05d}.safetensors"
            write_whole(self.folder / name, payload)
            self._models[name] = Seal.of(payload)

    def models(self) -> dict[int, bytes]:
        """Round -> meta-model kept, of rounds before the one that `restore` goes on from."""
        paths = [self.folder / name for name in self._models] if self.folder else []
        return {int(path.stem.removeprefix(_MODEL)): path.read_bytes() for path in paths}

    @property
    def was_finished(self) -> bool:
        """Whether it was finished once, if only until another time than now."""
        return self.folder is not None and (self.folder / _FINISHED).exists()

    @property
    def is_finished(self) -> bool:
        """Whether this method's stage was finished, and the robots have its models.

        Raises:
            RunError: another scenario's was, or the mark is not as it was written.
        """
        if self.folder is None or not self.was_finished:
            return False
        path = self.folder / _FINISHED
        owner, _, until = path.read_text(errors="replace").partition("\n")
        if owner != self._owner:
            raise RunError(f"{path}: not as it was written, or another scenario's; name another folder with --state")
        return until == (self._until or "")

    def finish(self) -> None:
        """The stage is over and its models are with the robots: forget all but that, unless it may go on."""
        if self.folder is not None:
            said = self._owner if self._until is None else f"{self._owner}\n{self._until}"
            write_whole(self.folder / _FINISHED, said.encode())
            if self._until is not None:
                return
            self._files.clear()
            for path in self.folder.iterdir():
                if path.name != _FINISHED:
                    path.unlink()

    def clear(self) -> None:
        """The run is over: leave no trace."""
        if self.folder is not None:
            (self.folder / _FINISHED).unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # somebody else's files may be in it
                self.folder.rmdir()

    def _has_told(self, part: str) -> bool:
        """Whether there is a row of a second round, before which the first one's state is saved."""
        if self.folder is None:
            return False
        path = self.folder.parent / _BESIDE[0]
        try:
            rows = [RoundRow.model_validate_json(line) for line in whole_lines(path, mend=False)]
        except ValidationError as error:
            raise RunError(f"{path}: not as it was written; begin the run anew") from error
        mine = [row for row in rows if (row.phase, row.arm) == self._whose and part in ("state", f"task-{row.task}")]
        return any(row.round > 1 for row in mine)

    def _file(self, part: str) -> StateFile:
        assert self.folder is not None
        if part not in self._files:
            self._files[part] = StateFile(self.folder / part, self._owner, durable=self._durable)
        return self._files[part]


def owner_of(scenario: Scenario, run: str, method: str) -> str:
    """Of all that a method's state depends on: it goes on bit by bit only where this is the same."""
    return hashlib.sha256(f"{run} {method} {scenario.determines}".encode()).hexdigest()


def forget(state: Path | None, checkpoints: Sequence[Checkpoint]) -> None:
    """The run is over: leave no trace."""
    for checkpoint in checkpoints:
        checkpoint.clear()
    if state is not None:
        own = ("rounds.jsonl", PROCESSOR, LOCK, "counters*", f"*{HANDED_IN}")
        for path in (path for each in own for path in state.glob(each)):
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # somebody else's files may be in it
            state.rmdir()
