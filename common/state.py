"""What a process goes on from after it was killed: named arrays and plain values, on disk whole or not at all."""

from __future__ import annotations

import json
import os
import struct
import zlib
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


NOTHING = Keep()


class StateFile:
    """The newest state of a process, in two files that are written in turn, in place.

    A kill in the middle of a write spoils one of them, and the other holds the state before. To replace a file by a
    new one would be as safe, and has file systems write to the disk each time.
    """

    def __init__(self, path: Path, owner: str, frames: Path | None = None, *, durable: bool = False) -> None:
        """
        Args:
            path: of the files, without their endings .0 and .1.
            owner: names the scenario and process; another owner's state is refused.
            frames: a file mapped into memory that belongs to the state (see `common.replay`).
            durable: have all on the disk when `save` returns. Else the kernel has it: that a process is killed loses
                nothing, but a power failure may.
        """
        self._paths = [path.with_name(f"{path.name}.{number}") for number in (0, 1)]
        self._owner, self._frames, self._durable = owner, frames, durable
        self._written: int | None = None
        path.parent.mkdir(parents=True, exist_ok=True)

    def save(self, state: State) -> None:
        """Write the state.

        Raises:
            RunError: it cannot be written.
        """
        if self._written is None:
            self._written = max((number for number, _ in self._whole()), default=0)
        arrays = {name: np.asarray(array, order="C") for name, array in state.arrays.items()}
        # Codecs lay a model's tensors end to end, in their order, which a safetensors file does not keep.
        metadata = {"owner": self._owner, "names": json.dumps(list(arrays)), "values": json.dumps(state.values)}
        content = safetensors.numpy.save(arrays, metadata=metadata)
        path, number = self._paths[self._written % 2], self._written + 1
        try:
            if self._durable and self._frames is not None and self._frames.exists():
                sync(self._frames)
            with path.open("r+b" if path.exists() else "wb") as file:
                file.write(_HEAD.pack(_MAGIC, number, len(content), zlib.crc32(content)))
                file.write(content)
            if self._durable:
                sync(path)
                sync(path.parent)
        except OSError as error:
            raise RunError(f"cannot write {path}: {error.strerror}") from error
        self._written = number

    def load(self) -> State | None:
        """The newest state saved; None if there is none.

        Raises:
            RunError: it is another owner's, or damaged.
        """
        whole = self._whole()
        if not whole:
            # One file alone that is not whole was being written for the first time: nothing has been saved.
            if all(path.exists() for path in self._paths):
                raise self._unfit("neither file is whole")
            return None
        _, content = max(whole)
        try:
            found = safetensors.numpy.load(content)
            (length,) = struct.unpack_from("<Q", content)
            metadata = json.loads(content[8 : 8 + length])["__metadata__"]
            arrays = {name: found[name] for name in json.loads(metadata["names"])}
            values = json.loads(metadata["values"])
        except (KeyError, ValueError, safetensors.SafetensorError) as error:
            raise self._unfit(str(error)) from error
        if metadata["owner"] != self._owner:
            raise self._unfit("it is another scenario's, run's or process's")
        return State(arrays, values)

    def _whole(self) -> list[tuple[int, bytes]]:
        """(number, content) of what was written to its end."""
        found = []
        for path in self._paths:
            written = path.read_bytes() if path.exists() else b""
            if len(written) < _HEAD.size:
                continue
            magic, number, size, checksum = _HEAD.unpack_from(written)
            content = written[_HEAD.size : _HEAD.size + size]
            if magic == _MAGIC and len(content) == size and zlib.crc32(content) == checksum:
                found.append((number, content))
        return found

    def _unfit(self, why: str) -> RunError:
        return RunError(
            f"state {self._paths[0].parent}: does not fit this scenario ({why}); name another folder with --state"
        )


_MAGIC = b"JouleSt1"
_HEAD = struct.Struct("<8sQQI")  # magic, number of the write, bytes of content, their CRC-32


def write_whole(path: Path, content: Payload, *, durable: bool = True) -> None:
    """Replace a file by `content`, whole or not at all; `durable`: not before it is on the disk.

    Raises:
        RunError: it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        part.replace(path)
        if durable:
            sync(path.parent)
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from error


def sync(path: Path) -> None:
    """Have a file or folder on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def generator_state(rng: np.random.Generator) -> dict[str, Any]:
    """A random generator as plain values."""
    return dict(rng.bit_generator.state)


def load_generator(rng: np.random.Generator, state: dict[str, Any]) -> None:
    """Bring a generator of the same kind to where another was."""
    rng.bit_generator.state = state
