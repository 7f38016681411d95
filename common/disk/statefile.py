"""The newest state of a process, on disk whole or not at all."""

from __future__ import annotations

import json
import os
import struct
import zlib
from dataclasses import dataclass
from io import RawIOBase
from pathlib import Path
from typing import Literal

import numpy as np
import safetensors
import safetensors.numpy

from jouleswarm.common.disk.files import sync
from jouleswarm.common.disk.seals import Seal
from jouleswarm.common.disk.state import State
from jouleswarm.common.disk.trouble import disk_error
from jouleswarm.common.errors import RunError


class StateFile:
    """The newest state of a process, in two files that are written in turn, in place.

    A kill in the middle of a write leaves that file marked as being written, and the other holds the state before: what
    the process had done since has not been told to anybody, so going on from it is going on exactly. A file that was
    written to its end and is not whole any more has been damaged; others have gone on since, so that the state before
    would lead to another result, and is refused. To replace a file by a new one would be as safe, and has file systems
    write to the disk each time.
    """

    def __init__(self, path: Path, owner: str | None, *, durable: bool = False) -> None:
        """
        Args:
            path: of the files, without their endings .0 and .1.
            owner: names the scenario and process; another owner's state is refused. None: anybody's, only to read.
            durable: have all on the disk when `save` returns. Else the kernel has it: that a process is killed loses
                nothing, but a power failure may.
        """
        self._paths = [path.with_name(f"{path.name}.{number}") for number in (0, 1)]
        self._owner, self._durable = owner, durable
        self._written: int | None = None
        if owner is not None:
            path.parent.mkdir(parents=True, exist_ok=True)

    def save(self, state: State) -> None:
        """Write the state.

        Raises:
            RunError: it cannot be written.
        """
        if self._written is None:
            newest = self._newest()
            self._written = newest.number if newest else 0
        arrays = {name: np.asarray(array, order="C") for name, array in state.arrays.items()}
        seals = {name: (seal.block_bytes, seal.first, seal.blocks) for name, seal in state.files.items()}
        sums = {f"{_SEAL}{name}": seal.checksums for name, seal in state.files.items()}
        # Codecs lay a model's tensors end to end, in their order, which a safetensors file does not keep.
        values = {"names": list(arrays), "values": state.values, "seals": seals}
        metadata = {"owner": self._owner or "", **{key: json.dumps(value) for key, value in values.items()}}
        content = safetensors.numpy.save(arrays | sums, metadata=metadata)
        path, number = self._paths[self._written % 2], self._written + 1
        try:
            if number == 1:
                self._paths[1].write_bytes(_head(_WRITING, 2))  # so that it is missed when it has gone
            self._write(path, number, content)
            if self._durable:
                sync(path.parent)
        except OSError as error:
            raise disk_error(path, error, len(content)) from error
        self._written = number

    def load(self, *, sealed: bool = True) -> State | None:
        """The newest state saved; None if there is none.

        `sealed`: see that the files that it relies on are as they were; without, for who only looks at one that its
        process goes on from meanwhile.

        Raises:
            RunError: it is another owner's, or it or a file that it relies on is not as it was written.
        """
        newest = self._newest()
        if newest is None:
            return None
        self._written = newest.number
        try:
            found = safetensors.numpy.load(newest.content)
            (length,) = struct.unpack_from("<Q", newest.content)
            metadata = json.loads(newest.content[8 : 8 + length])["__metadata__"]
            arrays = {name: found[name] for name in json.loads(metadata["names"])}
            values = json.loads(metadata["values"])
            files = {
                name: Seal(block_bytes, found[f"{_SEAL}{name}"], first, blocks)
                for name, (block_bytes, first, blocks) in json.loads(metadata["seals"]).items()
            }
        except (KeyError, ValueError, safetensors.SafetensorError) as error:
            raise self._unfit(str(error)) from error
        if self._owner is not None and metadata["owner"] != self._owner:
            raise self._unfit("it is another scenario's, run's or process's")
        for name, seal in files.items() if sealed else ():
            seal.check(self._paths[0].parent / name)
        return State(arrays, values, files)

    def tear(self) -> None:
        """Leave the files as a kill in the middle of the next write does, for who wants to see what comes of it."""
        newest = self._newest()
        number = newest.number if newest else 0
        if newest is None:
            self._paths[1].write_bytes(_head(_WRITING, 2))
        path = self._paths[number % 2]
        before = path.read_bytes()[_HEAD_BYTES:] if path.exists() else b""
        half = len(before) // 2
        path.write_bytes(_head(_WRITING, number + 1) + bytes(half) + before[half:])

    def _write(self, path: Path, number: int, content: bytes) -> None:
        """Mark the file as being written, write it, and mark it as whole."""
        with path.open("r+b" if path.exists() else "wb", buffering=0) as file:
            file.write(_head(_WRITING, number))
            _write_all(file, content)
            if self._durable:
                os.fsync(file.fileno())  # before it is called whole
            file.seek(0)
            file.write(_head(_WHOLE, number, len(content), zlib.crc32(content)))
            if self._durable:
                os.fsync(file.fileno())

    def _newest(self) -> _Written | None:
        """The newest state that was written to its end; None before the first was.

        Raises:
            RunError: that state is not whole any more.
        """
        files = [_read(path) for path in self._paths]
        whole = max((file for file in files if file.kind == "whole"), key=lambda file: file.number, default=None)
        if whole is None and tuple(file.kind for file in files) in _NOTHING_SAVED:
            return None
        number = whole.number if whole else 0
        for path, file in zip(self._paths, files, strict=True):
            is_older = file.kind == "damaged" and 0 < file.number < number  # not needed any more
            is_next = file.kind == "writing" and file.number == number + 1
            if not (file.kind == "whole" or is_older or is_next):
                raise self._damaged(path, file.kind)
        return whole

    def _damaged(self, path: Path, kind: str) -> RunError:
        why = "gone" if kind == "gone" else "not as it was written: cut short or altered"
        return RunError(f"state {path}: {why}; others have gone on since the state before it, so begin the run anew")

    def _unfit(self, why: str) -> RunError:
        return RunError(
            f"state {self._paths[0].parent}: does not fit this scenario ({why}); name another folder with --state"
        )


@dataclass(frozen=True)
class _Written:
    """What is in a file."""

    kind: Literal["whole", "writing", "damaged", "blank", "gone"]
    """whole: written to its end, and as it was. writing: not to its end. blank: nothing yet."""
    number: int = 0
    """Of the write; 0: not known."""
    content: bytes = b""


# The second file is made and marked, then the first one is.
_NOTHING_SAVED = (
    *(("gone", second) for second in ("gone", "blank", "writing")),
    *((first, "writing") for first in ("blank", "writing")),
)
_SEAL = "seal of "
_WHOLE, _WRITING = b"JouleSt2", b"JouleWr2"
_HEAD = struct.Struct("<8sQQI")  # magic, number of the write, bytes of content, their CRC-32; then its own CRC-32
_HEAD_BYTES = _HEAD.size + 4


def _head(magic: bytes, number: int, size_bytes: int = 0, checksum: int = 0) -> bytes:
    head = _HEAD.pack(magic, number, size_bytes, checksum)
    return head + struct.pack("<I", zlib.crc32(head))


def _read(path: Path) -> _Written:
    if not path.exists():
        return _Written("gone")
    written = path.read_bytes()
    if not any(written[:_HEAD_BYTES]):
        return _Written("blank")
    head = written[: _HEAD.size]
    if len(written) < _HEAD_BYTES or struct.pack("<I", zlib.crc32(head)) != written[_HEAD.size : _HEAD_BYTES]:
        return _Written("damaged")
    magic, number, size_bytes, checksum = _HEAD.unpack(head)
    if magic == _WRITING:
        return _Written("writing", number)
    content = written[_HEAD_BYTES : _HEAD_BYTES + size_bytes]
    if magic != _WHOLE or len(content) < size_bytes or zlib.crc32(content) != checksum:
        return _Written("damaged", number)
    return _Written("whole", number, content)


def _write_all(file: RawIOBase, content: bytes) -> None:
    left = memoryview(content)
    while left:
        left = left[file.write(left) :]
