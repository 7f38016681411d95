"""What has passed by windows of time, without topics, in a bounded number of rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from jouleswarm.common.meter.tally import MOST_ROWS, Direction, Kind, Row

_KEPT_LABELS = ("arm", "sender")  # which a bill depends on
_Counts = tuple[int, int, int, int]
_NOTHING: _Counts = (0, 0, 0, 0)


class Window(NamedTuple):
    """What passed in so many seconds: rows without topics, of this window alone."""

    begin_s: float
    """Since 1970."""
    window_s: float
    rows: list[Row]


class _Place(NamedTuple):
    direction: Direction
    kind: Kind
    client: str
    link: str
    phase: str
    rule: str
    number: int
    labels: tuple[tuple[str, str], ...]


class Windows:
    """Differences of cumulative rows by window. Beyond `most_rows` windows become twice as long, two by two."""

    def __init__(self, begin_s: float, window_s: float, most_rows: int = MOST_ROWS) -> None:
        """The first begins at `begin_s`, in seconds since 1970."""
        self._begin_s, self._window_s, self._most_rows = begin_s, window_s, most_rows
        self._held: dict[int, dict[_Place, _Counts]] = {}
        self._before: Mapping[_Place, _Counts] = {}

    def add(self, time_s: float, rows: Iterable[Row]) -> None:
        """What has been counted in all by now: what is new of it is of this moment's window."""
        before = self._before
        self.begin_from(rows)
        new = {place: _added(counts, before.get(place, _NOTHING), -1) for place, counts in self._before.items()}
        held = self._held.setdefault(max(0, int((time_s - self._begin_s) / self._window_s)), {})
        for place, counts in new.items():
            if any(counts):
                _book(held, place, counts)
        while len(self._held) > 1 and sum(map(len, self._held.values())) > self._most_rows:
            self._merge()

    def begin_from(self, rows: Iterable[Row]) -> None:
        """All this was there before."""
        now: dict[_Place, _Counts] = {}
        for row in rows:
            _book(now, _place(row), (row.messages, row.payload_bytes, row.packet_bytes, row.repeats))
        self._before = now

    def all(self) -> list[Window]:
        """Those in which anything passed, in their order."""
        return [
            Window(self._begin_s + number * self._window_s, self._window_s, [_row(*each) for each in held.items()])
            for number, held in sorted(self._held.items())
            if held
        ]

    def _merge(self) -> None:
        merged: dict[int, dict[_Place, _Counts]] = {}
        for number, held in self._held.items():
            into = merged.setdefault(number // 2, {})
            for place, counts in held.items():
                _book(into, place, counts)
        self._held, self._window_s = merged, 2 * self._window_s


def joined(windows: Sequence[Window], most: int) -> list[Window]:
    """The same time in so many windows at most, of several each; those in which nothing passed are left out."""
    if not windows:
        return []
    begin_s, window_s = windows[0].begin_s, windows[0].window_s
    several = 1 + round((windows[-1].begin_s - begin_s) / window_s) // most
    found: dict[int, list[Row]] = {}
    for window in windows:
        found.setdefault(round((window.begin_s - begin_s) / window_s) // several, []).extend(window.rows)
    step_s = several * window_s
    return [Window(begin_s + number * step_s, step_s, rows) for number, rows in found.items()]


def _place(row: Row) -> _Place:
    labels = tuple((name, row.labels[name]) for name in _KEPT_LABELS if name in row.labels)
    return _Place(row.direction, row.kind, row.client, row.link, row.phase, row.rule, row.number, labels)


def _row(place: _Place, counts: _Counts) -> Row:
    direction, kind, client, link, phase, rule, number, labels = place
    return Row(direction, kind, client, "", *counts, link, phase, rule, number, dict(labels))


def _book(held: dict[_Place, _Counts], place: _Place, counts: _Counts) -> None:
    held[place] = _added(held.get(place, _NOTHING), counts)


def _added(one: _Counts, other: _Counts, sign: int = 1) -> _Counts:
    a, b, c, d = (x + sign * y for x, y in zip(one, other, strict=True))
    return a, b, c, d
