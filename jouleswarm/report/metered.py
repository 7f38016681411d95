"""What a meter before somebody's broker has counted, for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from jouleswarm.metering.tally import Row
from jouleswarm.report.format import bytes_text
from jouleswarm.report.table import Table

_HEADINGS = ("link and rule", "sent", "bytes", "got", "bytes", "packets", "DUP")


def metered_table(rows: Sequence[Row], never: Iterable[str]) -> Table:
    """A row a rule: messages and payload bytes that were sent and that clients got, bytes of both in whole packets.

    Below it what is no message of any; `never` says of rules that nothing came to them.
    """
    groups: dict[tuple[int, str], list[Row]] = {}
    for row in rows:
        if row.kind == "publish":
            groups.setdefault((row.number or len(rows) + 1, f"{row.link}: {row.rule or 'no rule'}"), []).append(row)
    cells = [_cells(name, held) for (_, name), held in sorted(groups.items())]
    notes = [f"{each}: matched nothing (0 messages)" for each in never]
    for kind, what in (("control", "control packets"), ("unparsed", "not MQTT"), ("overflow", "beyond the most rows")):
        if held := [row for row in rows if row.kind == kind]:
            notes.append(f"{what}: {bytes_text(sum(row.packet_bytes for row in held))}")
    both = (sum(row.packet_bytes for row in rows if row.direction == way) for way in ("in", "out"))
    notes.append("all bytes of MQTT: to the broker {}, from it {}".format(*both))
    return Table("Metered", _HEADINGS, cells, notes)


def _cells(name: str, rows: Sequence[Row]) -> list[str | int]:
    cells: list[str | int] = [name]
    for way in ("in", "out"):
        held = [row for row in rows if row.direction == way]
        cells += [sum(row.messages for row in held), bytes_text(sum(row.payload_bytes for row in held))]
    return [*cells, bytes_text(sum(row.packet_bytes for row in rows)), sum(row.repeats for row in rows)]
