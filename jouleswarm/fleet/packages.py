"""The product's own package, whatever else goes by its name in the current folder, on PYTHONPATH or installed.

Run as a program, `python -P PATH/packages.py MODULE ARGUMENTS` is `python -m MODULE ARGUMENTS` for a module of ours.
Only the standard library is imported here: this comes before anything else.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
NAME = "jouleswarm"


class _OwnFinder(MetaPathFinder):
    """Finds it where this file is; everything else is found as ever."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, [str(ROOT)]) if name == NAME else None


def claim() -> None:
    """From now on its name means the product's package."""
    if not any(isinstance(finder, _OwnFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OwnFinder())


def command_of(module: str) -> list[str]:
    """The start of a command line that runs one of our modules: `python -m MODULE`, from any folder."""
    # -P: neither the current folder nor this file's is looked into for modules.
    return [sys.executable, "-P", str(Path(__file__).resolve()), module]


def _run() -> None:
    _, module, *arguments = sys.argv
    claim()
    sys.argv = [f"python -m {module}", *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    _run()
