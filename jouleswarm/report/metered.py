"""What a meter has counted: bytes and joules by link, client, phase, label and time."""

from __future__ import annotations

import datetime
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path

from rich import live

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.counts_bus import TOPIC
from jouleswarm.common.meter.tally import Row
from jouleswarm.common.scenario.reading import Override, energy_file
from jouleswarm.common.scenario.tariff import Tariff
from jouleswarm.energy.prices import price_lists
from jouleswarm.energy.rows import BESIDE
from jouleswarm.metering.cost import Cost, cost_of
from jouleswarm.metering.metered import Metered, load_metered
from jouleswarm.metering.windows import joined
from jouleswarm.metering.written import unmatched
from jouleswarm.report.format import bytes_text, joules_text
from jouleswarm.report.table import Cell, Table, terminal

_HEADINGS = ("joules", "sent", "bytes", "got", "bytes", "packets", "DUP")
_WATCHED = ("client", "link", "topic", "count", "bytes", "joules")
_WAYS = {"in": "from", "out": "to"}
_MOST_PRICED, _MOST_SHOWN, _WIDTH = 200, 20, 22
_EVERY_S = 2.0
_REST = "all others"

_Groups = Mapping[str, Sequence[Row]]


def metered_tables(metered: Metered, tariff: Tariff) -> list[Table]:
    """Messages and payload bytes that were sent and that clients got, bytes of both in whole packets, and joules: by
    link and rule, client, phase, label and time; a table of one row only by rule."""
    cost = cost_of(metered, tariff)
    rows = published(metered)
    by_rule = sorted(rows, key=lambda row: row.number or len(rows) + 1)
    told = [
        _table("By link and rule", "link: rule", _grouped(by_rule, _rule), cost)._replace(notes=metered_notes(metered)),
        *(_dearest(name, _grouped(rows, of), cost) for name, of in _sorts(rows).items()),
        _table("By time", "from (UTC)", _by_time(metered), cost),
    ]
    return [table for number, table in enumerate(told) if number == 0 or len(table.rows) > 1]


def sorted_table(metered: Metered, tariff: Tariff, what: str) -> Table:
    """The same by one thing alone: client, phase, or a label as it stands in the rules, such as +round.

    Raises:
        ConfigurationError: there is no such thing in what was counted.
    """
    sorts = _sorts(published(metered))
    if what not in sorts:
        raise ConfigurationError(f"by {what!r}: expected one of {', '.join(sorts)}")
    return _dearest(what, _grouped(published(metered), sorts[what]), cost_of(metered, tariff))


def watched_table(metered: Metered, tariff: Tariff) -> Table:
    """Who sends and gets most, by link and topic: those that cost most first.

    Raises:
        ConfigurationError: as `cost_of`.
    """
    cost = cost_of(metered, tariff)
    held = published(metered)
    most = sorted(held, key=lambda row: -row.packet_bytes)[:_MOST_PRICED]
    costs = sorted(((cost([row]), row) for row in most), key=lambda each: (-each[0], -each[1].packet_bytes))
    cells = [_watched(row, cost_j) for cost_j, row in costs[:_MOST_SHOWN]]
    left = [f"{len(held) - len(cells)} rows more"] if len(held) > len(cells) else []
    return Table(f"Metered, at {price_lists(tariff)[0].label}", _WATCHED, cells, left)


def watch(folder: Path, energy: Path | None, changes: Iterable[Override], *, by: str | None = None, once: bool) -> None:
    """Show the table of a meter's directory, once or anew for ever; `by`: of one thing (`sorted_table`).

    Raises:
        RunError: there is nothing to show.
        ConfigurationError: prices that can't be used.
    """
    held = [*energy_file(energy), *changes]
    with live.Live(auto_refresh=False) as shown:
        while True:
            metered = load_metered(folder)
            tariff, _ = metered.priced(held)
            table = watched_table(metered, tariff) if by is None else sorted_table(metered, tariff, by)
            shown.update(terminal(table), refresh=True)
            if once:
                return
            time.sleep(_EVERY_S)


def _watched(row: Row, cost_j: float) -> Sequence[Cell]:
    who = f"{_WAYS[row.direction]} {row.client or 'no id'}"
    return _short(who), row.link, _short(row.topic), row.messages, bytes_text(row.payload_bytes), joules_text(cost_j)


def _short(text: str) -> str:
    """So that a row fits a terminal; of topics the end tells more."""
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH // 2 - 1]}…{text[-_WIDTH // 2 :]}"


def _rule(row: Row) -> str:
    return f"{row.link}: {row.rule or 'no rule'}"


def published(metered: Metered) -> list[Row]:
    """Messages, and nothing of control."""
    return [row for row in metered.rows if row.kind == "publish"]


def _sorts(rows: Iterable[Row]) -> dict[str, Callable[[Row], str]]:
    """What rows can be told apart by -> what a row is of it; "" for those that have none."""
    labels = sorted(set(chain.from_iterable(row.labels for row in rows)))
    by_label = {f"+{label}": partial(_labelled, label) for label in labels}
    return {
        "client": client_name,
        "phase": lambda row: row.phase,
        **by_label,
    }


def client_name(row: Row) -> str:
    """Of a row, "" of what a client tells of itself."""
    return "" if row.topic.startswith(TOPIC) else row.client or "no id"


def _labelled(label: str, row: Row) -> str:
    return row.labels.get(label, "")


def _grouped(rows: Iterable[Row], name: Callable[[Row], str]) -> dict[str, list[Row]]:
    groups: dict[str, list[Row]] = {}
    for row in rows:
        if found := name(row):
            groups.setdefault(found, []).append(row)
    return groups


def _dearest(what: str, groups: _Groups, cost: Cost) -> Table:
    """The groups that moved most, dearest first, and all others as one."""
    most = sorted(groups, key=lambda name: -sum(row.packet_bytes for row in groups[name]))
    shown = {name: groups[name] for name in sorted(most[:_MOST_SHOWN], key=lambda name: -cost(groups[name]))}
    rest = [row for name in most[_MOST_SHOWN:] for row in groups[name]]
    return _table(f"By {what}", what, shown | ({_REST: rest} if rest else {}), cost)


def _by_time(metered: Metered) -> dict[str, list[Row]]:
    """Some twenty windows at most, of several of the meter's own each where it has more."""
    groups: dict[str, list[Row]] = {}
    for window in joined(metered.windows, _MOST_SHOWN):
        at = datetime.datetime.fromtimestamp(window.begin_s, datetime.UTC)
        groups[f"{at:%m-%d %H:%M:%S}"] = [row for row in window.rows if row.kind == "publish"]
    return groups


def _table(title: str, what: str, groups: _Groups, cost: Cost) -> Table:
    cells = [[name, joules_text(cost(rows)), *_sums(rows)] for name, rows in groups.items()]
    told = len(_HEADINGS) + any(row.repeats for rows in groups.values() for row in rows)  # DUP where there are any
    return Table(title, (what, *_HEADINGS)[:told], [row[:told] for row in cells])


def _sums(rows: Sequence[Row]) -> Iterator[Cell]:
    for way in ("in", "out"):
        held = [row for row in rows if row.direction == way]
        yield sum(row.messages for row in held)
        yield bytes_text(sum(row.payload_bytes for row in held))
    yield bytes_text(sum(row.packet_bytes for row in rows))
    yield sum(row.repeats for row in rows)


def metered_notes(metered: Metered) -> list[str]:
    """What is no message of any rule, and rules that nothing came to."""
    never = unmatched(metered.rows, metered.rules)
    notes = [f"{rule.text} ({rule.priced.link}), line {rule.line}: matched nothing (0 messages)" for rule in never]
    for kind, what in (("control", "control packets"), ("unparsed", "not MQTT"), ("overflow", "beyond the most rows")):
        if held := [row for row in metered.rows if row.kind == kind]:
            notes.append(f"{what}: {bytes_text(sum(row.packet_bytes for row in held))}")
    both = (sum(row.packet_bytes for row in metered.rows if row.direction == way) for way in ("in", "out"))
    if "of" not in metered.manifest:
        return [*notes, "all bytes of MQTT: to the broker {}, from it {}".format(*both)]
    arrays = (sum(int(each["value"]) for each in metered.told if each["what"] == what) for what in BESIDE)
    notes.append("all bytes of {} messages: to the server {}, from it {}".format(metered.manifest["of"], *both))
    return [*notes, "of them in arrays: to the server {}, from it {}".format(*arrays)]
