"""The run directory of a meter, written while it counts; `metered` reads it.

``manifest.json``   `kind` meter, the rules as they were written, prices, versions, host
``meter.jsonl``     cumulative counts by client, topic and direction
``windows.jsonl``   what passed by windows of time, without topics
``facts.jsonl``     what clients told of themselves, where any did
``bill.csv``        all of it for `jouleswarm bill`
``summary.json``    how it ended; without one the meter runs still, or was killed
"""

from __future__ import annotations

import datetime
import importlib.metadata
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.disk.lock import LOCK, Lock
from jouleswarm.common.doors import DOORS, file_of
from jouleswarm.common.errors import ConfigurationError, usable
from jouleswarm.common.host import machine
from jouleswarm.common.meter.tally import Row
from jouleswarm.common.scenario.reading import Override
from jouleswarm.common.scenario.tariff import Tariff, checked_tariff
from jouleswarm.common.wire.rules import read_rules
from jouleswarm.common.wire.topics import run_name
from jouleswarm.energy.prices import price_lists
from jouleswarm.metering.windows import Window
from jouleswarm.metering.written import Told, bill_csv

KIND, SCHEMA = "meter", 1
MANIFEST, METER, WINDOWS, FACTS, BILL, SUMMARY = (
    "manifest.json",
    "meter.jsonl",
    "windows.jsonl",
    "facts.jsonl",
    "bill.csv",
    "summary.json",
)


def folder_of(out: Path, name: str | None) -> Path:
    """Where a meter's run directory goes.

    Raises:
        ConfigurationError: the name can't be one.
    """
    return out / run_name(name or f"{KIND}-{datetime.datetime.now():%Y%m%d-%H%M%S}")


class Directory:
    """Writer of one, who holds it until the end of the context. Each file is whole, or as it was before."""

    def __init__(
        self,
        path: Path,
        links: Path,
        energy: Path | None = None,
        changes: Iterable[Override] = (),
        about: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """
        Args:
            path: of the directory.
            links: the file of rules.
            energy: a file of prices, with changes `energy.key=value`; default the paper's Table I.
            about: what else the manifest is to say.

        Raises:
            ConfigurationError: rules or prices can't be used, something is there already, or it can't be made.
        """
        self.path, self.links, self.rules = path, links, read_rules(links)
        tariff, prices = checked_tariff(energy, changes)
        price_lists(tariff)
        with usable("run directory", path):
            if path.exists() and any(each.name != LOCK for each in path.iterdir()):
                raise ConfigurationError(f"run directory {path} is not empty; name another with --out or --run-id")
        self._lock = Lock(path, "jouleswarm meter")
        self._keep(tariff)
        versions = {"python": platform.python_version(), "jouleswarm": importlib.metadata.version("jouleswarm")}
        self._manifest = {"kind": KIND, "schema": SCHEMA, "run": path.name, **prices, **about, "versions": versions}
        self._manifest |= {"host": machine(), "started": _now()}
        self._write_manifest()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def read_rules(self) -> None:
        """Go by the file of rules as it is now.

        Raises:
            ConfigurationError: it can't be; the rules before stay.
        """
        self.rules = read_rules(self.links)
        self._write_manifest()

    def write(self, rows: Sequence[Row], windows: Iterable[Window] = (), told: Sequence[Told] = ()) -> None:
        """What has been counted by now.

        Raises:
            RunError: it can't be written.
        """
        # Not asdict, which copies deeply, ten times as long.
        self._whole(METER, "".join(json.dumps(vars(row)) + "\n" for row in rows))
        self._whole(WINDOWS, "".join(map(_window_lines, windows)))
        if told:
            self._whole(FACTS, "".join(json.dumps(each) + "\n" for each in told))
        self._whole(BILL, bill_csv(rows, self.rules, told))

    def end(self) -> None:
        """All has been written.

        Raises:
            RunError: that can't be.
        """
        self._whole(SUMMARY, json.dumps({"status": "complete", "ended": _now()}, indent=2) + "\n")

    def _write_manifest(self) -> None:
        rules = self.links.read_text(encoding="utf-8")
        self._whole(MANIFEST, json.dumps(self._manifest | {"rules": rules}, indent=2) + "\n")

    def _keep(self, tariff: Tariff) -> None:
        """The user's files that prices name, as a run directory does."""
        named = [tariff.folder / tariff.energy.links] if tariff.energy.links else []
        files = (file_of(name, tariff.folder) for name in tariff.energy.prices)
        for file in (*named, *(each for each in files if each is not None)):
            with usable("file of prices", file):
                (self.path / DOORS).mkdir(exist_ok=True)
                write_whole(self.path / DOORS / file.name, file.read_bytes())

    def _whole(self, name: str, text: str) -> None:
        write_whole(self.path / name, text.encode())


def _window_lines(window: Window) -> str:
    return json.dumps(window._asdict() | {"rows": [vars(row) for row in window.rows]}) + "\n"


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
