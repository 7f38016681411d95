"""How this program was called, for commands that it prints: each can be pasted as it is."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path

NAME = "jouleswarm"
PROGRAM = "JOULESWARM_PROGRAM"
"""In the environment: what to type for this program where its user is, who may be outside of its container."""
FETCH = "JOULESWARM_FETCH"
"""In the environment: what to type to have its files there."""


def executable() -> str:
    """As `PROGRAM` has it; else `jouleswarm` where the shell finds this installation's by that name; else its path, as
    short as it can be from here; else `python -m jouleswarm` by this interpreter."""
    if told := os.environ.get(PROGRAM):
        return told
    own = Path(sys.executable).parent / NAME
    return _typed(own) if own.exists() else f"{python()} -m {NAME}"


def python() -> str:
    """`python` where the shell finds this interpreter by that name, else its path."""
    return _typed(Path(sys.executable))


def _typed(program: Path) -> str:
    found = shutil.which(program.name)
    if found and Path(found).parent == program.parent:
        return program.name
    return shlex.quote(_from_here(program))


def _from_here(path: Path) -> str:
    here = os.path.relpath(path)
    return str(path) if here.startswith(os.pardir) else here if os.sep in here else os.path.join(os.curdir, here)
