"""One owner of a folder: a lock of the kernel's, which ends with the process that holds it, however that ends."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import logging
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from jouleswarm.common.disk.trouble import full_disk_is_told
from jouleswarm.common.errors import ConfigurationError

LOCK = ".lock"
_WITHOUT = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # file systems that have no locks
_LOOK_EVERY_S = 0.1
_HOLDER_BYTES = 300

log = logging.getLogger("jouleswarm")


class Lock:
    """Holds a folder until `release`, or the end of the process; its children do not inherit it."""

    def __init__(self, folder: Path, holder: str) -> None:
        """Make the folder if need be, and hold it; `holder` is what others are told of this process.

        Raises:
            ConfigurationError: another process holds it, which is named, or the folder cannot be used.
        """
        self._path = folder / LOCK
        try:
            with full_disk_is_told(str(folder)):
                folder.mkdir(parents=True, exist_ok=True)
                while (descriptor := _hold(self._path)) is not None and not _is(descriptor, self._path):
                    os.close(descriptor)  # its last holder removed it meanwhile
                if descriptor is None:
                    raise ConfigurationError(f"{folder} is held by {_holder(self._path)}; end that, or name another")
                os.ftruncate(descriptor, 0)
                os.write(descriptor, f"{holder}, process {os.getpid()} on {socket.gethostname()}".encode())
        except OSError as error:
            raise ConfigurationError(f"cannot use folder {folder}: {error.strerror}; name another") from error
        self._descriptor = descriptor

    def release(self) -> None:
        """Let go of the folder, and leave nothing in it."""
        with contextlib.suppress(OSError):  # it may have gone, folder and all
            if _is(self._descriptor, self._path):
                self._path.unlink()
        os.close(self._descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def is_held(folder: Path) -> bool:
    """Whether somebody is at work on a folder; what is there stays as it is."""
    path = folder / LOCK
    if not path.exists():
        return False
    descriptor = _hold(path)
    if descriptor is not None:
        os.close(descriptor)
    return descriptor is None


def await_free(folder: Path, wait_s: float, told: Callable[[str], None]) -> None:
    """Wait until nobody holds a folder; `told` for whom.

    Raises:
        ConfigurationError: it is still held after `wait_s`.
    """
    path, until_s, is_told = folder / LOCK, time.monotonic() + wait_s, False
    while path.exists():
        descriptor = _hold(path)
        if descriptor is not None:
            os.close(descriptor)
            return
        if time.monotonic() > until_s:
            raise ConfigurationError(f"{folder} is held by {_holder(path)}; end that first")
        if not is_told:
            told(f"waiting for {_holder(path)} to end, which holds {folder}")
            is_told = True
        time.sleep(_LOOK_EVERY_S)


def _hold(path: Path) -> int | None:
    """A descriptor of the file that holds its lock; None if another process does."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    except OSError as error:
        if error.errno not in _WITHOUT:
            os.close(descriptor)
            raise
        log.warning("%s: this file system has no locks; see to it that no second process uses the folder", path.parent)
    return descriptor


def _is(descriptor: int, path: Path) -> bool:
    """Whether the file that is open is the one of this name."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _holder(path: Path) -> str:
    try:
        return path.read_bytes()[:_HOLDER_BYTES].decode(errors="replace") or "another process"
    except OSError:
        return "another process"
