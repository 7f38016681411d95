"""A disk that is full is told once and by name, and what is mapped into memory has its place on the disk beforehand."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from jouleswarm.common.errors import RunError

NO_SPACE = "no space left"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_WITHOUT = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)  # file systems that cannot allocate
_ZEROS = bytes(1 << 20)


def disk_error(path: str | Path, error: OSError, needed_bytes: int | None = None) -> RunError:
    """What to tell of a file that could not be written."""
    if error.errno not in _FULL:
        return RunError(f"cannot write {path}: {error.strerror}")
    needed = "" if needed_bytes is None else f" ({needed_bytes / 1e6:.1f} MB needed)"
    limit = "; a file may not grow so large here" if error.errno == errno.EFBIG else ""
    return RunError(f"{NO_SPACE} on {path}{needed}{limit}; make room, then go on from what is there")


@contextlib.contextmanager
def full_disk_is_told(what: str = "the disk") -> Iterator[None]:
    """Make an error of ours of a full disk, wherever it was met.

    Raises:
        RunError: there is no space left.
    """
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise disk_error(error.filename or what, error) from error
        raise


def is_full(folder: Path) -> bool:
    """Whether not even a line more can be written there."""
    try:
        found = os.statvfs(folder)
    except OSError:
        return False
    return found.f_bavail * found.f_frsize < 4096


def allocate(path: Path, size_bytes: int) -> None:
    """Make a file at least so large, zeros at its end, every byte with a place on the disk.

    A hole in a file that is mapped into memory ends the process with SIGBUS on a full disk.

    Raises:
        RunError: there is no space, or the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a+b") as file:
            before = file.seek(0, os.SEEK_END)
            try:
                _allocate(file.fileno(), before, size_bytes)
            except OSError:
                file.truncate(before)
                raise
    except OSError as error:
        raise disk_error(path, error, size_bytes) from error


def _allocate(descriptor: int, before: int, size_bytes: int) -> None:
    try:
        os.posix_fallocate(descriptor, 0, size_bytes)
    except OSError as error:
        if error.errno not in _WITHOUT:
            raise
        for start in range(before, size_bytes, len(_ZEROS)):
            os.write(descriptor, _ZEROS[: size_bytes - start])
