"""A meter's run directory without a meter: what it would have left of some packets."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from jouleswarm.common.meter.tally import Direction, Tally, rows_of
from jouleswarm.common.wire.rules import read_rules
from jouleswarm.metering.directory import Directory
from jouleswarm.metering.windows import Windows

BEGAN_S, WINDOW_S = 1000.0, 60.0
Packet = tuple[str, str, Direction, int]
"""Client, topic, direction, payload bytes; 10 bytes more are its head."""


class MadeUpMeter:
    """Counts and writes as a meter does; context manager, which is complete at its end."""

    def __init__(self, folder: Path, links: str, changes: Iterable[str] = ()) -> None:
        rules = folder.parent / f"{folder.name}.toml"
        rules.write_text(links)
        self.tally, self.windows, self.rules = Tally(), Windows(BEGAN_S, WINDOW_S), read_rules(rules)
        self.directory = Directory(folder, rules, None, changes)

    def __enter__(self) -> MadeUpMeter:
        return self

    def __exit__(self, *_: object) -> None:
        self.directory.end()
        self.directory.__exit__()

    def pass_by(self, window: int, packets: Iterable[Packet]) -> None:
        """Count them in a window, and write all."""
        for client, topic, direction, size in packets:
            self.tally.count(client, topic, (direction, "publish"), size, size + 10)
        rows = rows_of(self.tally.counts(), self.rules)
        self.windows.add(BEGAN_S + WINDOW_S * window + 1, rows)
        self.directory.write(rows, self.windows.all())
