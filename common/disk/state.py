"""What a process goes on from after it was killed: named arrays and plain values, on disk whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from jouleswarm.common.disk.seals import Seal
from jouleswarm.common.wire.types import Array


@dataclass(frozen=True)
class State:
    """Arrays by name, and values that JSON can hold exactly (floats are written so that they read back the same)."""

    arrays: dict[str, Array] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    files: dict[str, Seal] = field(default_factory=dict)
    """What the state relies on beside it, by name as seen from its folder; every part knows of all."""

    @classmethod
    def of(cls, parts: Mapping[str, State | Stateful]) -> State:
        """Parts put together; `part` and `into` take them out again."""
        states = {name: part if isinstance(part, State) else part.state() for name, part in parts.items()}
        return cls(
            {f"{name}/{key}": array for name, part in states.items() for key, array in part.arrays.items()},
            {name: part.values for name, part in states.items()},
            {name: seal for part in states.values() for name, seal in part.files.items()},
        )

    def part(self, name: str) -> State:
        """One of the parts that `of` put together."""
        start = f"{name}/"
        arrays = {key.removeprefix(start): array for key, array in self.arrays.items() if key.startswith(start)}
        return State(arrays, self.values[name], self.files)

    def into(self, parts: Mapping[str, Stateful]) -> None:
        """Have each of the parts take up its own."""
        for name, each in parts.items():
            each.load_state(self.part(name))


class Stateful(Protocol):
    """Something that can be written down and taken up again, bit by bit the same."""

    def state(self) -> State:
        """Everything that `load_state` needs; arrays may be views, to be written before anything changes."""

    def load_state(self, state: State) -> None:
        """Take up what `state` returned."""


@dataclass(frozen=True)
class Together:
    """Parts with a state each, as one."""

    parts: Mapping[str, Stateful]

    def state(self) -> State:
        return State.of(self.parts)

    def load_state(self, state: State) -> None:
        state.into(self.parts)


class KeptTensors(dict[str, Array]):
    """Tensors by name with a state."""

    def state(self) -> State:
        return State(dict(self))

    def load_state(self, state: State) -> None:
        self.update(state.arrays)


STATE_FILE = "state"


@dataclass(frozen=True)
class Keep:
    """What a process keeps on disk to go on from."""

    folder: Path | None = None
    """None: nothing."""
    durable: bool = False
    """Also for a power failure, not only for being killed."""
    at_the_end: bool = False
    """When the run is over too: whoever started the process deletes the folder."""
    ends: bool = False
    """Also how each arm ended, so that it can be gone on with for more rounds."""


NOTHING = Keep()


def generator_state(rng: np.random.Generator) -> dict[str, Any]:
    """A random generator as plain values."""
    return dict(rng.bit_generator.state)


def load_generator(rng: np.random.Generator, state: dict[str, Any]) -> None:
    """Bring a generator of the same kind to where another was."""
    rng.bit_generator.state = state
