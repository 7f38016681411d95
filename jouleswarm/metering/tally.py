"""What has passed a meter: counts by client, topic, direction and kind, in a bounded number of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, cast

from jouleswarm.common.meter.counters import Cell, Counts, Key
from jouleswarm.common.wire.rules import OTHER, Rule, find

Direction = Literal["in", "out"]
"""As the broker sees it: in is what a client sends, out what one receives."""
Kind = Literal["publish", "repeat", "control", "unparsed", "overflow"]
What = tuple[Direction, Kind]
MOST_ROWS = 20_000
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

    def __init__(self, most_rows: int = MOST_ROWS) -> None:
        self._cells, self._most_rows = dict[Key, Cell](), most_rows

    def count(self, client: str, topic: str, what: What, payload_bytes: int, packet_bytes: int) -> None:
        """Book a packet, or bytes of none; `what` is its direction and kind (repeat: once more, of those with DUP)."""
        direction, kind = what
        key = client, topic, f"{direction} {kind}"
        if cell := self._cells.get(key) or self._new(key, what):
            cell.add(payload_bytes, packet_bytes)

    def _new(self, key: Key, what: What) -> Cell | None:
        """The cell of a key that has none; None: of a repeat whose first message has overflowed."""
        (client, topic, _), (direction, kind) = key, what
        if kind == "repeat" and (client, topic, f"{direction} publish") not in self._cells:
            return None
        is_full = len(self._cells) >= self._most_rows and kind != "repeat"
        if is_full or len(client) + len(topic) > _MOST_NAME:
            key = "", "", f"{direction} overflow"
        return self._cells.setdefault(key, Cell())

    def counts(self) -> dict[Key, Counts]:
        """What has been counted by now, in the order of the keys."""
        return {key: self._cells[key].counts for key in sorted(self._cells)}


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


def _by_rule(row: Row, rules: Sequence[Rule]) -> Row:
    ends = (row.client, None) if row.direction == "in" else (None, row.client)
    if (rule := find(rules, row.topic, *ends)) is None:
        return replace(row, link=OTHER)
    labels, number = rule.labels(tuple(row.topic.split("/"))), rules.index(rule) + 1
    return replace(
        row, link=rule.priced.link.value, phase=rule.priced.phase, rule=rule.text, number=number, labels=labels
    )
