"""Every error that JouleSwarm raises on purpose: one shallow tree.

A message names what was got, what was expected and what to do. `exit_code` is what a process ends with
when the error reaches its top.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from os import PathLike, fsdecode
from pathlib import Path


class JouleSwarmError(Exception):
    """Root of the tree; catch this to catch all of ours."""

    exit_code = 1
    kind = "other"
    """In JSON documents (docs/exit_codes.md)."""


class ConfigurationError(JouleSwarmError):
    """A scenario, map, option or URL that cannot be used. Nothing has been written."""

    exit_code = 2
    kind = "configuration"


class BrokerUnreachableError(JouleSwarmError):
    """No broker answered within the time allowed."""

    exit_code = 3
    kind = "broker"


class PayloadError(JouleSwarmError):
    """A message from the bus that is not what its topic promises. It is refused and counted, never fatal."""


class TrainingError(JouleSwarmError):
    """Learning went wrong (a loss that is not finite, say). Always ends the process."""

    exit_code = 4
    kind = "training"


class RunError(JouleSwarmError):
    """A run that cannot go on or cannot be read: a process died, a file is missing."""

    exit_code = 5
    kind = "run"


class MessageTooLargeError(RunError):
    """A message that the broker does not take for its size. It would be sent, refused and sent again for ever."""


class StudyError(JouleSwarmError):
    """A study that cannot be planned, run to its end or read back."""

    exit_code = 6
    kind = "study"


class RemovedError(JouleSwarmError):
    """The broker had let this client in and does so no more: whoever keeps its users took it out."""

    exit_code = 7
    kind = "removed"


_USED_UP = {
    errno.EMFILE: "raise `ulimit -n`: some 100 files are enough",
    errno.ENFILE: "close other programs",
    errno.ENOMEM: "close other programs, or take fewer robots",
    errno.EAGAIN: "raise `ulimit -u`",
}


def used_up(error: OSError) -> str | None:
    """One line for what any call may find used up, which is never a defect; None for any other error."""
    advice = _USED_UP.get(error.errno or 0)
    return advice and f"{_said(error)}; {advice}"


@contextlib.contextmanager
def usable(what: str, path: Path | None, kind: type[JouleSwarmError] = ConfigurationError) -> Iterator[None]:
    """What the system says of a path that the user named becomes one of ours: what the path is for, which, and why.

    It may stand around much: errors of other files, and of what is no file, stay what they are.

    Raises:
        JouleSwarmError: of this kind, in place of an OSError of `path`, of what is in it or of a folder that it is in.
    """
    try:
        yield
    except OSError as error:
        if path is None or not _is_about(error, path.absolute()):
            raise
        advice = _USED_UP.get(error.errno or 0)
        raise kind(f"{what} {path}: {_said(error)}{f'; {advice}' if advice else ''}") from error


def _is_about(error: OSError, path: Path) -> bool:
    if not isinstance(error.filename, str | bytes | PathLike):
        return False
    named = Path(fsdecode(error.filename)).absolute()
    return named.is_relative_to(path) or path.is_relative_to(named)


def _said(error: OSError) -> str:
    of = f" ({fsdecode(error.filename)})" if isinstance(error.filename, str | bytes | PathLike) else ""
    return f"{error.strerror or error}{of}"
