"""The embedded broker's refusals, from its log to the terminal: who is refused would otherwise only seem to be slow."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

MOST_LINES = 20
_REFUSAL = re.compile(r"packet of \d+ bytes|refused|may not|dropped")
_STAMP = re.compile(r"^\d\d:\d\d:\d\d broker: ")
_PASSING = re.compile(r"(?<=\d):\d+|\.[0-9a-f]{8}\b")  # port and incarnation of a client: new at each try


class BrokerLog:
    """Tells what the broker has refused since the last look: each thing once, MOST_LINES at most."""

    def __init__(self, path: Path, told: Callable[[str], None]) -> None:
        self._path, self._told = path, told
        self._at = path.stat().st_size if path.exists() else 0
        self._known: set[str] = set()

    def show(self) -> None:
        """Look."""
        for line in self._new_lines():
            text = _STAMP.sub("", line)
            kind = _PASSING.sub("", text)
            if _REFUSAL.search(text) and kind not in self._known and len(self._known) <= MOST_LINES:
                self._known.add(kind)
                over = len(self._known) > MOST_LINES
                self._told(
                    f"the broker refuses more than is shown here: see {self._path}" if over else f"broker: {text}"
                )

    def _new_lines(self) -> list[str]:
        if not self._path.exists() or self._path.stat().st_size == self._at:
            return []
        with self._path.open("rb") as file:
            file.seek(self._at)
            whole, newline, _ = file.read().rpartition(b"\n")
        self._at += len(whole + newline)
        return whole.decode(errors="replace").splitlines()
