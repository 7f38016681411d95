"""What a process goes on from after it was killed: named arrays and plain values, on disk whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import safetensors
import safetensors.numpy

from common.bus import Payload
from common.errors import RunError

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class State:
    """Arrays by name, and values that JSON can hold exactly (floats are written so that they read back the same)."""

    arrays: dict[str, Array] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, parts: Mapping[str, State]) -> State:
        """Parts put together; `part` takes them out again."""
        return cls(
            {f"{name}/{key}": array for name, part in parts.items() for key, array in part.arrays.items()},
            {name: part.values for name, part in parts.items()},
        )

    def part(self, name: str) -> State:
        """One of the parts that `of` put together."""
        start = f"{name}/"
        arrays = {key.removeprefix(start): array for key, array in self.arrays.items() if key.startswith(start)}
        return State(arrays, self.values[name])


class Stateful(Protocol):
    """Something that can be written down and taken up again, bit by bit the same."""

    def state(self) -> State:
        """Everything that `load_state` needs; arrays may be views, to be written before anything changes."""

    def load_state(self, state: State) -> None:
        """Take up what `state` returned."""


class StateFile:
    """One state, replaced as a whole by each `save`: a safetensors file with the values in its metadata."""

    def __init__(self, path: Path, owner: str) -> None:
        """`owner`: names the scenario and process; another owner's state is refused."""
        self._path, self._owner = path, owner
        path.parent.mkdir(parents=True, exist_ok=True)

    def save(self, state: State) -> None:
        """Write the state; durable when this returns, also if the machine's power fails then.

        Raises:
            RunError: it cannot be written.
        """
        arrays = {name: np.asarray(array, order="C") for name, array in state.arrays.items()}
        # Codecs lay a model's tensors end to end, in their order, which a safetensors file does not keep.
        metadata = {"owner": self._owner, "names": json.dumps(list(arrays)), "values": json.dumps(state.values)}
        write_durably(self._path, safetensors.numpy.save(arrays, metadata=metadata))

    def load(self) -> State | None:
        """The newest state saved; None if there is none.

        Raises:
            RunError: it is another owner's, or damaged.
        """
        if not self._path.exists():
            return None
        try:
            with safetensors.safe_open(self._path, framework="np") as file:
                metadata = file.metadata() or {}
                if metadata["owner"] != self._owner:
                    raise ValueError("it is another scenario's, run's or process's")
                arrays = {name: file.get_tensor(name) for name in json.loads(metadata["names"])}
            return State(arrays, json.loads(metadata["values"]))
        except (KeyError, ValueError, OSError, safetensors.SafetensorError) as error:
            raise RunError(
                f"state {self._path}: does not fit this scenario ({error}); name another folder with --state"
            ) from error

    def clear(self) -> None:
        """Forget it."""
        self._path.unlink(missing_ok=True)


def write_durably(path: Path, content: Payload) -> None:
    """Replace a file by `content`, whole or not at all, and not before it is on the disk.

    Raises:
        RunError: it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from error


def generator_state(rng: np.random.Generator) -> dict[str, Any]:
    """A random generator as plain values."""
    return dict(rng.bit_generator.state)


def load_generator(rng: np.random.Generator, state: dict[str, Any]) -> None:
    """Bring a generator of the same kind to where another was."""
    rng.bit_generator.state = state
