"""The scenarios that there are: those that come with the package, and the user's own in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from jouleswarm.common.scenario.documents import parse_toml
from jouleswarm.common.scenario.reading import SCENARIOS

_FOR_EDITORS = "#:"
"""Such a comment names the file's schema."""


class OnShelf(NamedTuple):
    """A scenario, not checked."""

    name: str
    """As a command takes it: a plain name of one that comes with the package, else a file's."""
    what: str
    """The first line of its comment; else the name in it."""
    tasks: int


def on_shelf(folder: Path) -> list[OnShelf]:
    """Those of the package, then the *.toml of a folder that have tasks, each by name."""
    shipped = (_seen(path, path.stem) for path in sorted(SCENARIOS.glob("*.toml")))
    own = (_seen(path, path.name) for path in sorted(folder.glob("*.toml")))
    return [each for each in (*shipped, *own) if each is not None]


def _seen(path: Path, name: str) -> OnShelf | None:
    """None of a file that is no scenario: a list of constants, a project's settings."""
    try:
        text = path.read_text(encoding="utf-8")
        held = parse_toml(text)
    except (OSError, ValueError):
        return None
    tasks = held.get("tasks")
    if not isinstance(tasks, list) or not tasks:
        return None
    first = next((line for line in text.splitlines() if not line.startswith(_FOR_EDITORS)), "")
    what = first.lstrip("# ") if first.startswith("#") else f"name {held.get('name', 'unset')}"
    return OnShelf(name, what, len(tasks))
