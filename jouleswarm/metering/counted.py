"""Counts of several meters in a file (`common.meter.counts_file`), as the rows of one meter."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from jouleswarm.common.meter.counts_file import COLUMNS
from jouleswarm.common.meter.tally import Direction, Row
from jouleswarm.common.wire.rules import Rule
from jouleswarm.metering.written import Told

_WAYS: dict[str, tuple[str, Direction]] = {"uplink": ("up", "in"), "downlink": ("down", "out")}
_KINDS = ("bytes", "messages")
_Place = tuple[str, str, str, str, str]


def read_counted(path: Path, rules: Iterable[Rule]) -> tuple[list[Row], list[Told]]:
    """Bytes and messages as rows of topics arm/round/activity/up or down, and all else as it was told.

    Raises:
        OSError, ValueError, KeyError: it is not as it was written.
    """
    ordered = list(rules)
    sums: dict[_Place, dict[str, int]] = {}
    told: list[Told] = []
    with path.open(newline="", encoding="utf-8") as file:
        for cells in csv.DictReader(file, COLUMNS):
            if cells["arm"] == COLUMNS[0]:
                continue
            link, _, kind = cells["what"].partition("_")
            if link not in _WAYS or kind not in _KINDS:
                told.append(cells)
            else:
                place = link, cells["arm"], cells["round"], cells["activity"], cells["robot"]
                held = sums.setdefault(place, dict.fromkeys(_KINDS, 0))
                held[kind] += int(cells["value"])
    return [_row(place, held, ordered) for place, held in sorted(sums.items())], told


def _row(place: _Place, held: dict[str, int], rules: list[Rule]) -> Row:
    link, arm, round_, activity, client = place
    way, direction = _WAYS[link]
    number = next(number for number, rule in enumerate(rules, 1) if rule.priced.link == link)
    labels = {name: value for name, value in (("arm", arm), ("round", round_), ("activity", activity)) if value}
    return Row(
        direction, "publish", client, f"{arm}/{round_}/{activity}/{way}", held["messages"], held["bytes"],
        held["bytes"], 0, link, "fl", rules[number - 1].text, number, labels,
    )  # fmt: skip
