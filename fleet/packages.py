"""The product's own packages, whatever else goes by their names in the current folder, on PYTHONPATH or installed.

Run as a program, `python -P fleet/packages.py MODULE ARGUMENTS` is `python -m MODULE ARGUMENTS` for a module of ours.
Only the standard library is imported here: this comes before anything else.
"""

from __future__ import annotations

import importlib.metadata
import re
import runpy
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]
NAMES = ("agents", "broker", "common", "datacenter", "fleet", "studies")
_DISTRIBUTION = "jouleswarm"


class _OwnFinder(MetaPathFinder):
    """Finds them beside each other; everything else is found as ever."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, [str(ROOT)]) if name in NAMES else None


def claim() -> None:
    """From now on their names mean the product's packages."""
    if not any(isinstance(finder, _OwnFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OwnFinder())


def command_of(module: str) -> list[str]:
    """The start of a command line that runs one of our modules: `python -m MODULE`, from any folder."""
    # -P: neither the current folder nor this file's is looked into for modules.
    return [sys.executable, "-P", str(Path(__file__).resolve()), module]


def rivals(root: Path = ROOT) -> dict[str, str]:
    """Names of ours under which another distribution has put files into the same folder, and who that is.

    Whichever was installed last has written over files of the other.
    """
    pattern = re.compile(rf"^({'|'.join(NAMES)})[/.]", re.MULTILINE)
    found: dict[str, str] = {}
    for each in importlib.metadata.distributions(path=[str(root)]):
        if each.name != _DISTRIBUTION:
            listed = each.read_text("RECORD") or each.read_text("installed-files.txt") or ""
            found |= dict.fromkeys(pattern.findall(listed), each.name)
    return found


def _run() -> None:
    _, module, *arguments = sys.argv
    claim()
    sys.argv = [f"python -m {module}", *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    _run()
