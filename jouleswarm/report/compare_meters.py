"""`jouleswarm compare` of what meters have counted: bytes and joules by link side by side, and what rules differ."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import Any

from jouleswarm.common.meter.tally import Row
from jouleswarm.common.scenario.reading import Override
from jouleswarm.common.scenario.tariff import Tariff
from jouleswarm.metering.cost import cost_of
from jouleswarm.metering.metered import Metered, load_metered
from jouleswarm.report.format import bytes_text, joules_text
from jouleswarm.report.table import Cell, Table

_ALL = "all links"


@dataclass(frozen=True)
class Moved:
    """What was moved over one link."""

    sent: int
    """Messages that clients published."""
    got: int
    """Messages that clients were delivered."""
    packet_bytes: int
    """Of both, in whole MQTT packets."""
    joules: float


@dataclass(frozen=True)
class MetersCompared:
    """Meters' directories, what each link moved in each, and field -> its values, of rules and prices that differ."""

    metered: Sequence[Metered]
    moved: Sequence[Mapping[str, Moved]]
    differences: Mapping[str, Sequence[object]]

    @property
    def letters(self) -> str:
        return ascii_uppercase[: len(self.metered)]


def compared_meters(paths: Sequence[Path], changes: Iterable[Override] = ()) -> MetersCompared:
    """Read them; each at its own prices, with the same changes.

    Raises:
        ConfigurationError: a price that is none.
        RunError: one is damaged.
    """
    metered, held = [load_metered(path) for path in paths], list(changes)
    tariffs = [each.priced(held)[0] for each in metered]
    told = [_settings(each, tariff) for each, tariff in zip(metered, tariffs, strict=True)]
    names = dict.fromkeys(name for each in told for name in each)
    values = {name: [each.get(name) for each in told] for name in names}
    differences = {name: each for name, each in values.items() if any(one != each[0] for one in each)}
    moved = [_moved(each, tariff) for each, tariff in zip(metered, tariffs, strict=True)]
    return MetersCompared(metered, moved, differences)


def meters_table(found: MetersCompared) -> Table:
    """A row a link and quantity, a column a directory; of two the second over the first too."""
    rows: list[list[Cell]] = []
    for link in dict.fromkeys(link for each in found.moved for link in each):
        held = [each.get(link, Moved(0, 0, 0, 0.0)) for each in found.moved]
        for what, values, text in (
            ("joules", [each.joules for each in held], joules_text),
            ("bytes", [each.packet_bytes for each in held], bytes_text),
            ("messages sent", [each.sent for each in held], str),
            ("messages got", [each.got for each in held], str),
        ):
            if any(values):
                rows.append([f"{link}: {what}", *map(text, values), *_ratio(values)])
    letters = [*found.letters]
    note = "Bytes in whole MQTT packets, sent and got; joules by the first price list of each."
    return Table("Side by side", ["", *letters, *(["B / A"] if len(letters) == 2 else [])], rows, (note,))


def meters_lines(found: MetersCompared) -> Iterator[str]:
    """Which directory each letter is, and in what rules and prices differ."""
    for letter, each in zip(found.letters, found.metered, strict=True):
        yield f"{letter}: {each.path} (metered since {each.manifest['started']}, {each.status})"
    yield "Their rules and prices differ in:" if found.differences else "Their rules and prices are the same."
    for name, values in found.differences.items():
        told = (
            f"{letter} {'none' if value is None else value}"
            for letter, value in zip(found.letters, values, strict=True)
        )
        yield f"  {name}: {', '.join(told)}"


def meters_document(found: MetersCompared) -> dict[str, Any]:
    """The same as plain data; values of `differences` are in the order of `runs`."""
    runs = [
        {"path": str(each.path), "status": each.status, "links": {link: asdict(one) for link, one in moved.items()}}
        for each, moved in zip(found.metered, found.moved, strict=True)
    ]
    return {"runs": runs, "differences": dict(found.differences)}


def _moved(metered: Metered, tariff: Tariff) -> dict[str, Moved]:
    rows, cost = [row for row in metered.rows if row.kind == "publish"], cost_of(metered, tariff)
    links = dict.fromkeys(row.link for row in rows)
    groups: dict[str, list[Row]] = {_ALL: rows} | {link: [row for row in rows if row.link == link] for link in links}
    return {
        link: Moved(
            sent=sum(row.messages for row in held if row.direction == "in"),
            got=sum(row.messages for row in held if row.direction == "out"),
            packet_bytes=sum(row.packet_bytes for row in held),
            joules=cost(held),
        )
        for link, held in groups.items()
    }


def _settings(metered: Metered, tariff: Tariff) -> dict[str, object]:
    energy = tariff.energy.model_dump(mode="json", exclude_defaults=True)
    rules = {f"rule {rule.text}": f"{rule.priced.link}, {rule.priced.phase}" for rule in metered.rules}
    return {f"energy.{key}": value for key, value in energy.items()} | rules


def _ratio(values: Sequence[float]) -> list[Cell]:
    if len(values) != 2:
        return []
    first, second = values
    return [f"{second / first:.3g}" if first else None]
