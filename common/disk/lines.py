"""Files of lines that a killed process may have left with a torn last one."""

from __future__ import annotations

from pathlib import Path


def whole_lines(path: Path, *, mend: bool = True) -> list[bytes]:
    """The lines of a file that end in a newline; none if there is no file. With `mend` the rest is cut off."""
    if not path.exists():
        return []
    content = path.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    if mend and len(whole) < len(content):
        with path.open("r+b") as file:
            file.truncate(len(whole))
    return whole.splitlines()
