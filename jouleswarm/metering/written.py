"""What a meter leaves: every row as JSON, and counts that `jouleswarm bill` prices."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.wire.rules import Rule, read_rules
from jouleswarm.common.wire.topics import Link
from jouleswarm.metering.tally import Row

METER, BILL, RULES = "meter.jsonl", "bill.csv", "links.toml"
_COLUMNS = ("arm", "phase", "robot", "to", "what", "value")
_MOST_ARM = 100  # characters that the calculator takes
_Cells = tuple[str, str, int | str, int | str, str]


def write_rows(folder: Path, rows: Sequence[Row], rules: Sequence[Rule]) -> None:
    """Both files, each whole or not at all.

    Raises:
        RunError: they can't be written.
    """
    lines = "".join(json.dumps(vars(row)) + "\n" for row in rows)  # asdict copies deeply, ten times as long
    write_whole(folder / METER, lines.encode())
    write_whole(folder / BILL, bill_csv(rows, rules).encode())


def unmatched(rows: Iterable[Row], rules: Sequence[Rule]) -> list[Rule]:
    """Rules that no packet has come to."""
    seen = {row.number for row in rows}
    return [rule for number, rule in enumerate(rules, 1) if number not in seen]


def read_metered(folder: Path) -> tuple[list[Row], list[Rule]]:
    """What a meter has written, or writes still.

    Raises:
        ConfigurationError: there is nothing.
        RunError: it is not as it was written.
    """
    try:
        lines = (folder / METER).read_text(encoding="utf-8").splitlines()
        return [Row(**json.loads(line)) for line in lines], read_rules(folder / RULES)
    except (OSError, ValueError, TypeError) as error:
        kind = ConfigurationError if isinstance(error, OSError) else RunError
        raise kind(f"{folder / METER}: cannot be read ({error}), expected what `jouleswarm meter` writes") from error


def numbers_of(rows: Iterable[Row]) -> dict[str, int]:
    """The number that each client goes by in a bill, as a robot."""
    names = sorted({name for row in rows if _is_priced(row) for name in _ends(row) if name})
    return {name: number for number, name in enumerate(names, 1)}


def bill_rows(rows: Sequence[Row], rules: Sequence[Rule], numbers: Mapping[str, int]) -> list[dict[str, Any]]:
    """Rows for `jouleswarm bill`: payload bytes and messages by link, and who sent or received them.

    An uplink costs what is sent, a downlink what arrives, at each who receives; a sidelink what arrives, and beside it
    what is sent once. Of a rule with `receiver`, which only what arrives can match, that counts.
    """
    priced = [row for row in rows if _is_priced(row)]
    sums: dict[_Cells, int] = {}
    delivered = {row.number for row in priced if row.direction == "out"}
    for row in priced:
        is_sent = row.link == Link.UPLINK and not rules[row.number - 1].priced.receiver
        sender, receiver = (numbers.get(name, "") for name in _ends(row))
        robot = receiver if row.link == Link.DOWNLINK else sender
        to = receiver if row.link == Link.SIDELINK and sender else ""
        for what, value in _counts(row, is_sent, row.number in delivered):
            cells = " ".join(row.labels.get("arm", "").split())[:_MOST_ARM], row.phase, robot, to, f"{row.link}_{what}"
            sums[cells] = sums.get(cells, 0) + value
    found = (dict(zip(_COLUMNS, (*cells, value), strict=True)) for cells, value in sorted(sums.items(), key=str))
    return [{column: cell for column, cell in cells.items() if cell != ""} for cells in found]


def bill_csv(rows: Sequence[Row], rules: Sequence[Rule]) -> str:
    """The same as a file, which says who is which robot."""
    numbers, file = numbers_of(rows), io.StringIO()
    file.write("# Payload bytes and messages as they were metered. Price them: jouleswarm bill bill.csv\n")
    for name, number in numbers.items():
        file.write(f"# robot {number} is {name!r}\n")
    writer = csv.DictWriter(file, _COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(bill_rows(rows, rules, numbers))
    return file.getvalue()


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
