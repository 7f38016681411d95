"""What a meter before somebody's broker has counted, for the terminal."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich import live

from jouleswarm.common.meter.tally import Row
from jouleswarm.common.scenario.reading import Override
from jouleswarm.common.scenario.tariff import Tariff, read_tariff
from jouleswarm.common.wire.rules import Rule
from jouleswarm.energy.calculator import facts_of
from jouleswarm.energy.prices import price, price_lists
from jouleswarm.energy.rows import read_rows
from jouleswarm.metering.written import bill_rows, numbers_of, read_metered
from jouleswarm.report.format import bytes_text, joules_text
from jouleswarm.report.table import Cell, Table, terminal

_HEADINGS = ("link and rule", "sent", "bytes", "got", "bytes", "packets", "DUP")
_WATCHED = ("client", "link", "topic", "count", "bytes", "joules")
_WAYS = {"in": "from", "out": "to"}
_MOST_PRICED, _MOST_SHOWN, _WIDTH = 200, 20, 22
_EVERY_S = 2.0


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


def watched_table(rows: Sequence[Row], rules: Sequence[Rule], tariff: Tariff) -> Table:
    """Who sends and gets most, by link and topic: those that cost most first, by the tariff's first price list.

    Raises:
        ConfigurationError: the tariff asks for what the rows don't tell, of who sent something say.
    """
    (prices, *_), numbers = price_lists(tariff), numbers_of(rows)

    def joules(row: Row) -> float:
        if not (counted := bill_rows([row], rules, numbers)):
            return 0.0
        bills = (
            price(prices, facts, tariff.energy)
            for facts in facts_of(read_rows(counted), by_robot=tariff.is_by_robot).values()
        )
        return sum(bill.total_j for bill in bills if bill is not None)

    held = [row for row in rows if row.kind == "publish"]
    most = sorted(held, key=lambda row: -row.packet_bytes)[:_MOST_PRICED]
    costs = sorted(((joules(row), row) for row in most), key=lambda each: (-each[0], -each[1].packet_bytes))
    cells = [_watched(row, cost) for cost, row in costs[:_MOST_SHOWN]]
    left = [f"{len(held) - len(cells)} rows more"] if len(held) > len(cells) else []
    return Table(f"Metered, at {prices.label}", _WATCHED, cells, left)


def _watched(row: Row, cost_j: float) -> Sequence[Cell]:
    who = f"{_WAYS[row.direction]} {row.client or 'no id'}"
    return _short(who), row.link, _short(row.topic), row.messages, bytes_text(row.payload_bytes), joules_text(cost_j)


def _short(text: str) -> str:
    """So that a row fits a terminal; of topics the end tells more."""
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH // 2 - 1]}…{text[-_WIDTH // 2 :]}"


def _cells(name: str, rows: Sequence[Row]) -> list[str | int]:
    cells: list[str | int] = [name]
    for way in ("in", "out"):
        held = [row for row in rows if row.direction == way]
        cells += [sum(row.messages for row in held), bytes_text(sum(row.payload_bytes for row in held))]
    return [*cells, bytes_text(sum(row.packet_bytes for row in rows)), sum(row.repeats for row in rows)]


def watch(folder: Path, energy: Path | None, changes: Iterable[Override], *, once: bool) -> None:
    """Show the table of a meter's folder, once or anew for ever.

    Raises:
        RunError: there is nothing to show.
        ConfigurationError: prices that can't be used.
    """
    with live.Live(auto_refresh=False) as shown:
        while True:
            rows, rules = read_metered(folder)
            tariff = read_tariff(energy, changes, set(numbers_of(rows).values()))
            shown.update(terminal(watched_table(rows, rules, tariff)), refresh=True)
            if once:
                return
            time.sleep(_EVERY_S)
