"""What a process started by the launcher runs first."""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import sys
from pathlib import Path

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def run_module(module: str, arguments: list[str], log: Path) -> None:
    """Run `python -m MODULE ARGUMENTS` in this process, its output going to the file `log`."""
    _end_with_fork_server()
    os.setsid()  # a Ctrl-C at the terminal is for the launcher alone, which ends its children itself
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    sys.argv = [f"python -m {module}", *arguments]
    importlib.import_module(f"{module}.__main__").app()


def _end_with_fork_server() -> None:
    """The kernel ends this process when its parent ends: also if the launcher was killed, or does not know of it."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() == 1:  # too late
            raise SystemExit(128 + signal.SIGTERM)
