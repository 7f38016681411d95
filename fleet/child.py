"""What a process started by the launcher runs first."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path


def run_module(module: str, arguments: list[str], log: Path) -> None:
    """Run `python -m MODULE ARGUMENTS` in this process, its output going to the file `log`."""
    os.setsid()  # a Ctrl-C at the terminal is for the launcher alone, which ends its children itself
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    sys.argv = [f"python -m {module}", *arguments]
    importlib.import_module(f"{module}.__main__").app()
