"""What has passed a meter: counts by client, topic, direction and kind, in a bounded number of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, cast

from jouleswarm.common.meter.cells import Cell, Counts, Key
from jouleswarm.common.meter.counters import Counters
from jouleswarm.common.wire.rules import OTHER, Rule, find

Direction = Literal["in", "out"]
"""As the broker sees it: in is what a client sends, out what one receives."""
Kind = Literal["publish", "repeat", "control", "unparsed", "overflow"]
What = tuple[Direction, Kind]
MOST_ROWS = 20_000
RULED = "ruled"
"""Folder of the broker's, in that of its state."""
_MOST_NAME = 2000  # characters of client and topic


@dataclass(frozen=True)
class Row:
    """Cumulative traffic of one client on one topic in one direction.

    kind: publish; control, all other packets; unparsed, bytes in no packet (its messages are pieces of the stream);
    overflow, packets that there was no row left for, of whomever.
    """

    direction: Direction
    kind: Kind
    client: str
    topic: str
    messages: int
    payload_bytes: int
    packet_bytes: int
    repeats: int
    """Messages with DUP among them."""
    link: str = ""
    """Of publish: a link class, or other."""
    phase: str = ""
    rule: str = ""
    """Its filter; "" for what no rule matches."""
    number: int = 0
    """Of the rule in the file, from 1."""
    labels: Mapping[str, str] = field(default_factory=dict)


class Tally:
    """The counters; more than `most_rows` topics and clients are counted together."""

    def __init__(self, most_rows: int = MOST_ROWS, folder: Path | None = None) -> None:
        """`folder`: as of `Counters`, whose errors it has."""
        self._cells, self._most_rows = Counters(folder), most_rows
        self._known: dict[Key, Cell] = {}  # with a row of their own: one look for each packet

    def cell(self, client: str, topic: str, what: What) -> Cell | None:
        """Where to book packets, or bytes of none; `what` is their direction and kind.

        repeat is for those with DUP, once more; None where their publish has no row of its own.
        """
        direction, kind = what
        key = client, topic, f"{direction} {kind}"
        return self._known.get(key) or self._new(key, what)

    def count(self, client: str, topic: str, what: What, payload_bytes: int, packet_bytes: int) -> None:
        """Book one."""
        if (cell := self.cell(client, topic, what)) is not None:
            cell.add(payload_bytes, packet_bytes)

    def has(self, client: str, topic: str, what: What) -> bool:
        """Whether they have a row of their own."""
        return (client, topic, " ".join(what)) in self._cells

    def _new(self, key: Key, what: What) -> Cell | None:
        (client, topic, _), (direction, kind) = key, what
        if key not in self._cells:
            if kind == "repeat" and (client, topic, f"{direction} publish") not in self._cells:
                return None  # it has overflowed
            is_full = len(self._cells) >= self._most_rows and kind != "repeat"
            if is_full or len(client) + len(topic) > _MOST_NAME:
                return self._cells.cell(("", "", f"{direction} overflow"))
        self._known[key] = self._cells.cell(key)
        return self._known[key]

    def counts(self) -> dict[Key, Counts]:
        """What has been counted by now, in the order of the keys."""
        return dict(self._cells.items())


def rows_of(counts: Mapping[Key, Counts], rules: Sequence[Rule]) -> list[Row]:
    """All that a tally has counted, in a stable order, each by the rule that matches it first."""
    found = []
    for (client, topic, what), held in counts.items():
        direction, kind = cast(tuple[Direction, Kind], tuple(what.split()))
        if kind == "repeat":
            continue
        repeats = counts.get((client, topic, f"{direction} repeat"), (0,))[0]
        row = Row(direction, kind, client, topic, *held, repeats)
        found.append(_by_rule(row, rules) if kind == "publish" else row)
    return found


def rule_of(rules: Sequence[Rule], topic: str, client: str, direction: Direction) -> Rule | None:
    """The rule of what a client sends (in) or gets (out) on a topic."""
    ends = (client, None) if direction == "in" else (None, client)
    return find(rules, topic, *ends)


def _by_rule(row: Row, rules: Sequence[Rule]) -> Row:
    if (rule := rule_of(rules, row.topic, row.client, row.direction)) is None:
        return replace(row, link=OTHER)
    labels, number = rule.labels(tuple(row.topic.split("/"))), rules.index(rule) + 1
    return replace(
        row, link=rule.priced.link.value, phase=rule.priced.phase, rule=rule.text, number=number, labels=labels
    )
