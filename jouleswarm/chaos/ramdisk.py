"""A disk of a run's own, in memory, that can be made full at any moment; where this user may mount one."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_LARGEST = "50%"  # of the memory, of which it takes what is written
_TRIES = 100


@dataclass(frozen=True)
class RamDisk:
    """A file system at `path`."""

    path: Path

    def fill(self) -> None:
        """Leave no room but in what has been begun: it is made as small as what is on it.

        What is written at that moment makes it larger, and the system then leaves the size as it was: tried again.
        """
        any(self._shrink() for _ in range(_TRIES))

    def _shrink(self) -> bool:
        held = os.statvfs(self.path)
        return _mount("-o", f"remount,size={(held.f_blocks - held.f_bfree) * held.f_frsize}", str(self.path))

    def make_room(self) -> None:
        """End what `fill` did."""
        _mount("-o", f"remount,size={_LARGEST}", str(self.path))


@contextlib.contextmanager
def ram_disk(path: Path) -> Iterator[RamDisk | None]:
    """A disk at a folder that is new; in the end the folder holds what was on it. None: this user cannot mount any."""
    path.mkdir(parents=True)
    if not _mount("-t", "tmpfs", "-o", f"size={_LARGEST}", "jouleswarm", str(path)):
        yield None
        return
    disk = RamDisk(path)
    try:
        yield disk
    finally:
        disk.make_room()
        kept = shutil.copytree(path, path.with_name(f"{path.name}.kept"))
        subprocess.run(["umount", "--lazy", str(path)], check=True)
        path.rmdir()
        kept.rename(path)


def _mount(*arguments: str) -> bool:
    command = shutil.which("mount")
    return (
        command is not None and not subprocess.run([command, *arguments], capture_output=True, check=False).returncode
    )
