"""The data center's memory on disk: after each round enough to go on from there, bit by bit the same."""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

from common.scenario import CHANGES_NOTHING, Scenario
from common.state import State, StateFile, Stateful, sync, write_whole

_FINISHED = "finished"


class Checkpoint:
    """One method's folder: a state for each part that learns by itself, replaced each round. None remembers nothing."""

    def __init__(self, folder: Path | None, owner: str = "", *, durable: bool = False) -> None:
        """`owner`: see `owner_of`; `durable`: see `common.state.StateFile`."""
        self.folder, self._owner, self._durable = folder, owner, durable
        self._files: dict[str, StateFile] = {}
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def save(self, round_: int, state: State, part: str = "state") -> None:
        """Keep where `part` stands after `round_`; whole or not at all."""
        if self.folder is not None:
            if self._durable:
                for frames in self.folder.glob("*.bin"):
                    sync(frames)
            self._file(part).save(State.of({"learned": state, "done": State(values={"round": round_})}))

    def load(self, part: str = "state") -> tuple[int, State] | None:
        """The last whole round of `part` and its state.

        Raises:
            RunError: the folder holds another scenario's, or it is damaged.
        """
        state = self._file(part).load() if self.folder is not None else None
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
            write_whole(self.folder / f"model-{round_:05d}.safetensors", payload)

    def models(self) -> dict[int, bytes]:
        """Round -> meta-model kept, of rounds before the one that `restore` goes on from."""
        paths = sorted(self.folder.glob("model-*.safetensors")) if self.folder else []
        return {int(path.stem.removeprefix("model-")): path.read_bytes() for path in paths}

    @property
    def is_finished(self) -> bool:
        """Whether this method's stage was finished, and the robots have its models."""
        return self.folder is not None and (self.folder / _FINISHED).exists()

    def finish(self) -> None:
        """The stage is over and its models are with the robots: forget all but that."""
        if self.folder is not None:
            (self.folder / _FINISHED).touch()
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

    def _file(self, part: str) -> StateFile:
        assert self.folder is not None
        if part not in self._files:
            self._files[part] = StateFile(self.folder / part, self._owner, durable=self._durable)
        return self._files[part]


def owner_of(scenario: Scenario, run: str, method: str) -> str:
    """Of all that a method's state depends on: it goes on bit by bit only where this is the same."""
    settings = scenario.model_dump_json(exclude=CHANGES_NOTHING)
    return hashlib.sha256(f"{run} {method} {settings}".encode()).hexdigest()
