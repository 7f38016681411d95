"""Around every command: signals, where output goes, and errors as one line and a code."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TextIO

from jouleswarm.cli.silence import Silence
from jouleswarm.common.process import STOPPED, one_line_errors

if TYPE_CHECKING:
    from typing_extensions import Buffer

_GONE = (errno.EPIPE, errno.EIO)  # a pipe whose reader has ended, a terminal that was closed


@contextlib.contextmanager
def command_line() -> Iterator[None]:
    """Run a command's body: an error of ours is one line and its exit code, a defect keeps its traceback.

    SIGTERM (a container or a service manager stops a run) and SIGHUP (its terminal is closed) are as Ctrl-C.
    """
    silence = Silence("".join(sys.argv[1:2]), sys.argv[2:])
    sys.stdout, sys.stderr = _lasting(sys.stdout, silence.end), _lasting(sys.stderr, silence.end)
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as `nohup` has it
            signal.signal(number, signal.default_int_handler)
    try:
        with one_line_errors(f"jouleswarm {shlex.join(sys.argv[1:2])}"):
            yield
    except (KeyboardInterrupt, SystemExit) as end:
        if (stop := _stop_behind(end)) is None:
            raise
        print(str(stop) or "stopped", file=sys.stderr)
        raise SystemExit(STOPPED) from None
    finally:
        silence.end()


def _stop_behind(end: BaseException) -> KeyboardInterrupt | None:
    """The KeyboardInterrupt that made a command end; Typer makes an exit code of it."""
    if isinstance(end, SystemExit) and end.code != STOPPED:
        return None
    error: BaseException | None = end
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


class _Lasting(io.FileIO):
    """Where output goes. When nobody reads it any more it is lost: no reason to end a run of hours."""

    def __init__(self, descriptor: int, before: Callable[[], None]) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._before = before

    def write(self, data: Buffer, /) -> int:
        self._before()
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in _GONE:
                raise
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)
        if self.fileno() == 1:
            print("jouleswarm: nobody reads this output any more; going on without it", file=sys.stderr)
        return memoryview(data).nbytes


def _lasting(stream: TextIO, before: Callable[[], None]) -> TextIO:
    """`stream`, if it is the process's own, with writing that never fails for the reader's or the alphabet's sake.

    `before`: called before anything is written.
    """
    if stream is None or stream not in (sys.__stdout__, sys.__stderr__):
        return stream
    stream.flush()
    raw = io.BufferedWriter(_Lasting(stream.fileno(), before))
    errors = "replace" if stream is sys.__stdout__ else stream.errors
    return io.TextIOWrapper(raw, encoding=stream.encoding, errors=errors, line_buffering=True)
