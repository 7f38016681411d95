"""What clients tell of themselves, from messages of `common.meter.counts_bus`, in a bounded number of rows."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from jouleswarm.common.errors import PayloadError
from jouleswarm.common.meter.counts_bus import hear
from jouleswarm.common.meter.counts_file import COLUMNS
from jouleswarm.energy.named import CENTER
from jouleswarm.energy.rows import Row
from jouleswarm.metering.written import Told

MOST_ROWS = 20_000
_MOST_SENDERS, _MOST_NAME = 10_000, 100
_KEYS = tuple(column for column in COLUMNS if column != "value")
_PARTS = "robot", "to"
_Key = tuple[str, ...]

log = logging.getLogger("jouleswarm.metering")


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid")

    sender: str = Field(alias="from", max_length=_MOST_NAME)
    number: int = Field(ge=1)
    rows: list[list[JsonValue]]


class Heard:
    """Adds up; any thread may tell, and any ask. Beyond `most_rows` rounds are not told apart."""

    def __init__(self, most_rows: int = MOST_ROWS) -> None:
        self._most_rows, self._lock = most_rows, threading.Lock()
        self._sums: dict[_Key, float] = {}
        self._last: dict[str, int] = {}
        self.refused = 0
        """Messages, of which the first was told in the log."""

    def hear(self, payload: bytes) -> None:
        """Add a message, which may have come before; one that is none is refused, and counted."""
        try:
            self.take(payload)
        except PayloadError as error:
            self.refused += 1
            if self.refused == 1:
                log.warning("%s; refused, as are others like it", error)

    def take(self, payload: bytes) -> None:
        """The same.

        Raises:
            PayloadError: it is none; nothing of it is added.
        """
        try:
            message = _Message.model_validate_json(payload)
            rows = [_checked(cells) for cells in message.rows]
        except ValueError as error:
            raise PayloadError(f"facts: {_first(error)}, expected what `jouleswarm.Meter` sends") from error
        with self._lock:
            if message.number <= self._last.get(message.sender, 0):
                return
            if message.sender not in self._last and len(self._last) >= _MOST_SENDERS:
                raise PayloadError(f"facts: of more than {_MOST_SENDERS} senders")
            self._last[message.sender] = message.number
            for key, value in rows:
                self._add(key, value)

    def rows(self) -> list[Told]:
        """All by now, in a stable order."""
        with self._lock:
            sums = sorted(self._sums.items())
        return [dict(zip(_KEYS, key, strict=True)) | {"value": round(value, 9)} for key, value in sums]

    def _add(self, key: _Key, value: float) -> None:
        if key not in self._sums and len(self._sums) >= self._most_rows:
            key = tuple("" if column == "round" else cell for column, cell in zip(_KEYS, key, strict=True))
            if key not in self._sums and len(self._sums) >= 2 * self._most_rows:
                raise PayloadError(f"facts: of more than {2 * self._most_rows} kinds")
        self._sums[key] = self._sums.get(key, 0.0) + value


@contextlib.contextmanager
def heard(url: str | None, name: str) -> Iterator[Callable[[], Sequence[Told]]]:
    """What meters tell the broker there from here on; of no broker nothing. `name` is of the run.

    Raises:
        ConfigurationError: the URL is none.
    """
    if url is None:
        yield tuple
        return
    held = Heard()
    end = hear(url, name, held.hear)
    try:
        yield held.rows
    finally:
        end()


def _checked(cells: list[Any]) -> tuple[_Key, float]:
    """A row's columns but its value, and that.

    Raises:
        ValueError: it is no row of a bill.
    """
    row = {column: str(cell) for column, cell in zip(COLUMNS, cells, strict=True)}
    names = [row[part] for part in _PARTS if row[part]]
    if any(len(name) > _MOST_NAME or not name.isprintable() for name in names):
        raise ValueError("a name that is none")
    numbered = {part: row[part] if row[part] == CENTER else 1 for part in _PARTS if row[part]}
    found = Row.model_validate({key: cell for key, cell in row.items() if cell and key not in _PARTS} | numbered)
    return tuple(row[column] for column in _KEYS), found.value


def _first(error: ValueError) -> str:
    return str(error.errors()[0]["msg"]) if isinstance(error, ValidationError) else str(error)
