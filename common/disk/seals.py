"""Checksums of the files that a state relies on: whoever goes on from it finds them as they were, or is told."""

from __future__ import annotations

import os
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jouleswarm.common.errors import RunError
from jouleswarm.common.wire.types import Payload

Checksums = npt.NDArray[np.uint32]


@dataclass(frozen=True)
class Seal:
    """CRC-32 of some of a file's blocks: as many as there are `checksums`, from block `first` on.

    After the last of `blocks` comes the first one again. What else is in the file does not matter.
    """

    block_bytes: int
    checksums: Checksums
    first: int = 0
    blocks: int = 1

    @classmethod
    def of(cls, content: Payload) -> Seal:
        """Of a whole file."""
        return cls(len(content), np.array([zlib.crc32(content)], np.uint32))

    def is_like(self, other: Seal) -> bool:
        """Whether both are of the same content."""
        mine, theirs = ((each.block_bytes, each.checksums.tolist()) for each in (self, other))
        return mine == theirs

    def check(self, path: Path) -> None:
        """See whether the file is as it was.

        Raises:
            RunError: it is not, or cannot be read.
        """
        if not len(self.checksums):
            return
        try:
            with path.open("rb") as file:
                for place, expected in enumerate(self.checksums.tolist(), start=self.first):
                    file.seek(place % self.blocks * self.block_bytes)
                    content = file.read(self.block_bytes)
                    if len(content) < self.block_bytes:
                        raise _damaged(path, f"cut short to {os.fstat(file.fileno()).st_size} bytes")
                    if zlib.crc32(content) != expected:
                        raise _damaged(path, f"altered in block {place % self.blocks + 1} of {self.blocks}")
        except OSError as error:
            raise _damaged(path, error.strerror or str(error)) from error


class Growing:
    """A file of lines that is only added to, and the checksum of its whole lines so far."""

    def __init__(self, path: Path) -> None:
        self._path, self._size_bytes, self._checksum = path, 0, 0

    def seal(self) -> Seal:
        """Of what is in it by now; only what is new is read."""
        if self._path.exists():
            with self._path.open("rb") as file:
                file.seek(self._size_bytes)
                added = file.read()
            added = added[: added.rfind(b"\n") + 1]
            self._size_bytes, self._checksum = self._size_bytes + len(added), zlib.crc32(added, self._checksum)
        # Of a file that is not there yet, or has nothing in it, nothing is held.
        held = [self._checksum] if self._size_bytes else []
        return Seal(self._size_bytes, np.array(held, np.uint32))


def _damaged(path: Path, why: str) -> RunError:
    return RunError(f"{os.path.normpath(path)}: not as it was written ({why}); nothing can go on from it: begin anew")
