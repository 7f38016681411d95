"""The run directory of a Flower run, as `jouleswarm report` and `bill` read a meter's.

``manifest.json``  `kind` meter, the rules by which rows are told apart, versions; prices are those of the paper
``counts.csv``     rows of clients and rounds, appended when an exchange ends
``summary.json``   that the strategy has come to its end; without one it runs still, or was broken off
"""

from __future__ import annotations

import datetime
import importlib.metadata
import json
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.errors import usable
from jouleswarm.common.meter.counts_file import COUNTS, CountsFile, Rows

_RULES = """"+arm/+round/+activity/up" = { link = "uplink" }
"+arm/+round/+activity/down" = { link = "downlink" }
"""


class Directory:
    """Writer of one. A run that meters several strategies has one for all."""

    def __init__(self, out: Path, run: str) -> None:
        """
        Args:
            out: the folder that it is made in.
            run: Flower's number.

        Raises:
            ConfigurationError: it cannot be made, or holds something else.
        """
        self.path = (out / f"flower-{run}").absolute()
        with usable("run directory", self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        self._file = CountsFile(self.path / COUNTS, f"of Flower's run {run}")
        versions = {each: importlib.metadata.version(each) for each in ("flwr", "jouleswarm")}
        versions["python"] = platform.python_version()
        manifest = {"kind": "meter", "schema": 1, "of": "Flower", "run": self.path.name, "rules": _RULES}
        manifest |= {"energy": {}, "robots": [], "versions": versions, "started": _now()}
        if not (self.path / "manifest.json").exists():
            self._whole("manifest.json", manifest)

    def add(self, rows: Rows) -> None:
        """Append them.

        Raises:
            OSError: none of them can be written.
        """
        self._file.put(rows)

    def end(self) -> None:
        """All has been written.

        Raises:
            RunError: that cannot be.
        """
        self._whole("summary.json", {"status": "complete", "ended": _now()})

    def _whole(self, name: str, told: Mapping[str, Any]) -> None:
        write_whole(self.path / name, f"{json.dumps(told, indent=2)}\n".encode())


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
