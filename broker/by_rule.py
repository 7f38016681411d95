"""What passes the broker by anybody's rules (`--links`): a tally of all packets, and totals of each rule."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from jouleswarm.common.bus.paho_client import name_of
from jouleswarm.common.meter.cells import Cell, Counts
from jouleswarm.common.meter.tally import Direction, Kind, Row, Tally, rows_of, rule_of
from jouleswarm.common.wire.rules import OTHER, Rule, read_rules

_ASSIGNED = "amqtt/"  # begins the ids that amqtt gives to clients without one, a new one at each connection

_PUBLISH: Kind = "publish"
_CONTROL: Kind = "control"


class RuleKey(NamedTuple):
    """What the totals are kept by: of a kind, of a rule, one way."""

    kind: Kind
    direction: Direction
    link: str = ""
    phase: str = ""
    rule: str = ""
    sender: str = ""
    receiver: str = ""


class RuleMeter:
    """Counts for the event loop; `totals` may be asked for by any thread."""

    def __init__(self, links: Path, folder: Path | None = None, *, by_user: bool = False) -> None:
        """
        Args:
            links: the file of rules.
            folder: where the tally of a broker that was killed is gone on from.
            by_user: whether a client goes by its user's name, which there has to be then.

        Raises:
            ConfigurationError: a rule can't be.
            RunError: the folder can't be gone on from.
        """
        self.links, self._by_user = links, by_user
        self._rules = read_rules(links)
        self._tally = Tally(folder=folder)
        self._totals = _cells_of(self._rules, {})
        for row in rows_of(self._tally.counts(), self._rules):
            rule = self._rules[row.number - 1] if row.number else None
            key = _key_of(rule, row.direction) if row.kind == "publish" else RuleKey(row.kind, row.direction)
            self._totals[key].add(row.payload_bytes, row.packet_bytes, row.messages)

    def read_anew(self) -> int:
        """Go by the file as it is now: all that was counted in the tally, and what comes in the totals.

        Gives the number of rules; raises ConfigurationError, and goes by the old ones on, if a rule can't be.
        """
        self._rules = read_rules(self.links)
        self._totals = _cells_of(self._rules, self._totals)
        return len(self._rules)

    def cells(self, client_id: str, topic: str, direction: Direction) -> tuple[tuple[Cell, ...], bool]:
        """Where to book the PUBLISH packets of a client on a topic, and whether they have a row of their own.

        Without a topic, which no PUBLISH is: its packets of all other kinds.

        Raises:
            RunError: there is no space for it.
        """
        client, what = self._name(client_id), (direction, _PUBLISH if topic else _CONTROL)
        cell = self._tally.cell(client, topic, what)
        assert cell is not None  # only repeats have none
        if not (has_row := self._tally.has(client, topic, what)):
            key = RuleKey("overflow", direction)
        elif topic:
            key = _key_of(rule_of(self._rules, topic, client, direction), direction)
        else:
            key = RuleKey("control", direction)
        return (cell, self._totals[key]), has_row

    def repeated(self, client_id: str, topic: str, direction: Direction, payload_bytes: int, packet_bytes: int) -> None:
        """Book, beside it, that a PUBLISH had DUP."""
        self._tally.count(self._name(client_id), topic, (direction, "repeat"), payload_bytes, packet_bytes)

    def totals(self) -> dict[RuleKey, Counts]:
        """Messages, payload bytes and packet bytes of each rule, since it has been one."""
        return {key: cell.counts for key, cell in self._totals.items()}

    def rows(self) -> list[Row]:
        """All that was counted, by the rules as they are now."""
        return rows_of(self._tally.counts(), self._rules)

    def told(self) -> list[str]:
        """A line for each rule, and for what has none."""
        rows, lines = self.rows(), []
        for number, rule in enumerate(self._rules, 1):
            held = [row for row in rows if row.number == number]
            lines.append(f"{self.links}, line {rule.line}, {rule.text} ({rule.priced.link}): {_sums(held)}")
        for name, held in (
            ("other, which no rule matches", [row for row in rows if row.link == OTHER]),
            ("beyond the most rows", [row for row in rows if row.kind == "overflow"]),
        ):
            lines += [f"{name}: {_sums(held)}"] if held else []
        return lines

    def _name(self, client_id: str) -> str:
        if self._by_user:
            return name_of(client_id)  # the broker lets nobody in whose id is not of its user
        return "" if client_id.startswith(_ASSIGNED) else client_id


def _cells_of(rules: Sequence[Rule], before: Mapping[RuleKey, Cell]) -> dict[RuleKey, Cell]:
    """A cell for each total that there can be; those that were there before go on."""
    ways: tuple[Direction, ...] = ("in", "out")
    kinds: tuple[Kind, ...] = ("control", "overflow")
    keys = [_key_of(rule, way) for rule in (*rules, None) for way in ways]
    keys += [RuleKey(kind, way) for kind in kinds for way in ways]
    return {key: before.get(key) or Cell() for key in keys}


def _key_of(rule: Rule | None, direction: Direction) -> RuleKey:
    if rule is None:
        return RuleKey("publish", direction, OTHER)
    told = rule.priced
    return RuleKey("publish", direction, told.link.value, told.phase, rule.text, told.sender or "", told.receiver or "")


def _sums(rows: Sequence[Row]) -> str:
    if not rows:
        return "matched nothing (0 messages)"
    found = []
    for way, what in (("in", "received"), ("out", "delivered")):
        held = [row for row in rows if row.direction == way]
        messages, payload_bytes = sum(row.messages for row in held), sum(row.payload_bytes for row in held)
        found.append(f"{messages} messages of {payload_bytes} bytes {what}")
    return ", ".join(found)
