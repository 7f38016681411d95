"""What was metered as rows that `jouleswarm bill` prices. Pure."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from jouleswarm.common.meter.tally import Row
from jouleswarm.common.wire.rules import Rule
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.named import CENTER
from jouleswarm.energy.named import numbers_of as numbers_by_name

_BYTES = ("arm", "phase", "robot", "to", "what", "value")
_COLUMNS = ("arm", "phase", "task", "robot", "to", "what", "value", "activity", "round", "how")
_MOST_ARM = 100  # characters that the calculator takes
_Cells = tuple[str, str, int | str, int | str, str]
Told = Mapping[str, Any]
"""A row of what clients tell of themselves, with the columns of `jouleswarm bill` and robots by name."""


def unmatched(rows: Iterable[Row], rules: Sequence[Rule]) -> list[Rule]:
    """Rules that no packet has come to."""
    seen = {row.number for row in rows}
    return [rule for number, rule in enumerate(rules, 1) if number not in seen]


def numbers_of(rows: Iterable[Row], told: Iterable[Told] = ()) -> dict[str, int]:
    """The number that each client goes by in a bill, as a robot (see `energy.named`)."""
    names = {name for row in rows if _is_priced(row) for name in _ends(row) if name}
    return numbers_by_name(names | {str(each["robot"]) for each in told if each.get("robot")} - {CENTER})


def delivered_of(rows: Iterable[Row]) -> set[int]:
    """Numbers of the rules whose messages arrived somewhere."""
    return {row.number for row in rows if _is_priced(row) and row.direction == "out"}


def bill_rows(
    rows: Iterable[Row], rules: Sequence[Rule], numbers: Mapping[str, int], delivered: Collection[int] | None = None
) -> list[dict[str, Any]]:
    """Rows for `jouleswarm bill`: payload bytes and messages by link, and who sent or received them.

    An uplink costs what is sent, a downlink what arrives, at each who receives; a sidelink what arrives, and beside it
    what is sent once. Of a rule with `receiver`, which only what arrives can match, that counts.

    Args:
        rows: all, or some, to be priced by themselves.
        rules: that they are of.
        numbers: of all clients.
        delivered: of all rows (`delivered_of`), where these are some.
    """
    priced = [row for row in rows if _is_priced(row)]
    sums: dict[_Cells, int] = {}
    delivered = delivered_of(priced) if delivered is None else delivered
    for row in priced:
        is_sent = row.link == Link.UPLINK and not _has_receiver(row, rules)
        sender, receiver = (numbers.get(name, "") for name in _ends(row))
        robot = receiver if row.link == Link.DOWNLINK else sender
        to = receiver if row.link == Link.SIDELINK and sender else ""
        for what, value in _counts(row, is_sent, row.number in delivered):
            cells = " ".join(row.labels.get("arm", "").split())[:_MOST_ARM], row.phase, robot, to, f"{row.link}_{what}"
            sums[cells] = sums.get(cells, 0) + value
    found = (dict(zip(_BYTES, (*cells, value), strict=True)) for cells, value in sorted(sums.items(), key=str))
    return [{column: cell for column, cell in cells.items() if cell != ""} for cells in found]


def told_rows(told: Iterable[Told], numbers: Mapping[str, int]) -> list[dict[str, Any]]:
    """What clients have told for a bill: all but bytes and messages, which have been metered."""
    return [
        {
            column: numbers.get(str(each[column]), each[column]) if column == "robot" else each[column]
            for column in _COLUMNS
            if each.get(column) not in (None, "")
        }
        for each in told
        if not str(each["what"]).endswith(("_bytes", "_messages"))
    ]


def bill_csv(rows: Sequence[Row], rules: Sequence[Rule], told: Sequence[Told] = ()) -> str:
    """The same as a file, which says who is which robot."""
    numbers, file = numbers_of(rows, told), io.StringIO()
    file.write("# Payload bytes and messages as they were metered. Price them: jouleswarm bill bill.csv\n")
    for name, number in sorted(numbers.items(), key=lambda each: each[1]):
        file.write(f"# robot {number} is {name!r}\n")
    found = [*bill_rows(rows, rules, numbers), *told_rows(told, numbers)]
    used = [column for column in _COLUMNS if column in _BYTES or any(column in row for row in found)]
    writer = csv.DictWriter(file, used, lineterminator="\n")
    writer.writeheader()
    writer.writerows(found)
    return file.getvalue()


def _has_receiver(row: Row, rules: Sequence[Rule]) -> bool:
    """Of its rule, unless that is no more: rules may have been read anew since its window."""
    rule = rules[row.number - 1] if row.number <= len(rules) else None
    return rule is not None and rule.text == row.rule and rule.priced.receiver is not None


def _is_priced(row: Row) -> bool:
    return row.link in (Link.UPLINK, Link.DOWNLINK, Link.SIDELINK) and row.payload_bytes > 0


def _ends(row: Row) -> tuple[str, str]:
    """Who sent it and who receives it, "" where it can't be known: a level +sender tells it of what arrives."""
    if row.direction == "in":
        return (row.client, "") if row.link != Link.DOWNLINK else ("", "")
    sender = row.labels.get("sender", "") if row.link != Link.DOWNLINK else ""
    return sender, row.client if row.link != Link.UPLINK else ""


def _counts(row: Row, is_sent: bool, is_delivered: bool) -> Iterator[tuple[str, int]]:
    if row.direction == ("in" if is_sent else "out"):
        yield "bytes", row.payload_bytes
        yield "messages", row.messages
    elif row.link == Link.SIDELINK and is_delivered:
        yield "sent_bytes", row.payload_bytes
