"""What every process's `__main__` does alike: logging, signals, one thread, errors as exit codes."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType

from jouleswarm.common.disk.trouble import full_disk_is_told
from jouleswarm.common.errors import JouleSwarmError, RunError, used_up

STOPPED = 130
ROUNDS_LOG = "jouleswarm.rounds"
"""Name of the log of what a process does, a line a round."""


@contextlib.contextmanager
def process(name: str, *, verbose: bool = False, quiet: bool = False) -> Iterator[None]:
    """Run a process's body: an error of ours ends it with one clear line and its exit code.

    `verbose`: it says on stderr what it waits for, and unless `quiet` what it does, a line a round.

    SIGTERM and SIGINT end it at once, quietly. Any other exception is a defect and keeps its traceback.
    """
    logging.basicConfig(
        level=logging.INFO if verbose else logging.WARNING,
        format=f"%(asctime)s {name}: %(message)s",
        datefmt="%H:%M:%S",
        stream=sys.stderr,
    )
    rounds = logging.getLogger(ROUNDS_LOG)
    rounds.setLevel(logging.WARNING if quiet else logging.NOTSET)
    rounds.info("starting: loading PyTorch takes a few seconds")
    signal.signal(signal.SIGTERM, _stop)
    signal.signal(signal.SIGINT, _stop)
    with one_line_errors(name):
        yield


@contextlib.contextmanager
def one_line_errors(name: str) -> Iterator[None]:
    """An error of ours ends the process with one line and its exit code; so does what the system has used up."""
    try:
        with full_disk_is_told():
            yield
    except JouleSwarmError as error:
        told, code = str(error), error.exit_code
    except OSError as error:
        if (line := used_up(error)) is None:
            raise
        told, code = line, RunError.exit_code
    else:
        return
    try:
        print(f"{name}: {told}", file=sys.stderr, flush=True)
    except OSError:  # on a full disk; Python would try once more, and end with a code of its own
        os._exit(code)
    raise SystemExit(code)


def on_hangup(read_anew: Callable[[], object], end: Callable[[], None]) -> None:
    """Have SIGHUP call `read_anew` in the running event loop; where the terminal was closed, `end`, unless ignored."""
    import asyncio  # which few processes need

    lives_on = not os.isatty(0) or signal.getsignal(signal.SIGHUP) == signal.SIG_IGN

    def heard() -> None:
        (read_anew if lives_on or os.isatty(0) else end)()

    asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, heard)


def use_one_thread() -> None:
    """One thread of arithmetic a process: robots share the cores, and results do not depend on their number."""
    import cv2
    import torch

    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)


def leave_at_once(code: int) -> None:
    """End without waiting for the network thread; the bus's last will tells the others."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _stop(signum: int, _frame: FrameType | None) -> None:
    # Work under way may be a long call into C, or a wait for a network that is gone: do not wait for either. Nor flush:
    # the signal may have come in the middle of a write, which cannot be begun again inside itself.
    os._exit(STOPPED if signum == signal.SIGINT else 128 + signum)
