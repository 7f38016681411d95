"""The data center's memory on disk: after each round enough to go on from there, bit by bit the same."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jouleswarm.common.disk.checkpoint import States, clear, place_of
from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.disk.seals import Seal
from jouleswarm.common.disk.state import STATE_FILE, State, Stateful
from jouleswarm.common.errors import RunError

_FINISHED = "finished"
_MODEL = "model-"


class Checkpoint(States):
    """One method's folder: a state for each part that learns by itself, replaced each round.

    Rows and counters are the data center's, in the folder above.
    """

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
            owner: see `common.disk.checkpoint.owner_of`.
            whose: phase and arm of its rows.
            durable: see `common.disk.statefile.StateFile`.
            until: when it is finished, in words: it goes on from its states where that is another time. None: it is
                finished for good, and forgets them.
        """
        super().__init__(folder, owner, folder and folder.parent, durable=durable)
        self._whose, self._until = whose, until
        self._models: dict[str, Seal] = {}

    def save(self, round_: int, state: State | Stateful, part: str = STATE_FILE) -> None:
        """Keep where `part` stands after `round_`; whole or not at all."""
        self.put(part, {"round": round_}, {"learned": state}, self._models)

    def load(self, part: str = STATE_FILE) -> tuple[int, State] | None:
        """The last whole round of `part` and its state.

        Raises:
            RunError: the folder holds another scenario's, or it is damaged.
        """
        # Before the row of a second round the first one's state is saved.
        state = self.get(
            part,
            lambda row: (
                (row["phase"], row["arm"]) == self._whose
                and part in (STATE_FILE, f"task-{row['task']}")
                and row["round"] > 1
            ),
        )
        if state is None:
            return None
        self._models = {name: seal for name, seal in state.files.items() if name.startswith(_MODEL)}
        return place_of(state)["round"], state.part("learned")

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
            if self._until is None:
                self._files.clear()
                for path in self.folder.iterdir():
                    if path.name != _FINISHED:
                        path.unlink()


def forget(state: Path | None, checkpoints: Sequence[Checkpoint]) -> None:
    """The run is over: leave no trace."""
    for folder in [*(checkpoint.folder for checkpoint in checkpoints), state]:
        if folder is not None:
            clear(folder, _FINISHED)
