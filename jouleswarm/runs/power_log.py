"""Logs of power meters: CSV files with a time, watts or a counter of joules, and the device's name."""

from __future__ import annotations

import csv
import datetime
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from jouleswarm.common.errors import ConfigurationError, usable

_COLUMNS = {
    "time": ("time", "timestamp"),
    "watt": ("watt", "watts", "power.draw"),
    "joules": ("joules", "joule"),
    "name": ("name",),
}
_UNIT = re.compile(r"\s*\[.*\]$")  # of a heading of nvidia-smi


class Log(NamedTuple):
    """What one device read, in the order of time."""

    time_s: list[float]
    """Seconds since 1970."""
    values: list[float]
    """Watts, or joules since any moment."""
    is_counter: bool


def read_logs(files: Iterable[Path]) -> dict[str, Log]:
    """The logs of all files by the devices' names; a file without names is one device's, named as the file.

    Raises:
        ConfigurationError: one cannot be read, or a line is no sample.
    """
    found: dict[str, Log] = {}
    for file in files:
        with usable("--meter", file), file.open(encoding="utf-8-sig", newline="") as lines:
            try:
                _read(csv.reader(lines, skipinitialspace=True), file, found)
            except (UnicodeDecodeError, csv.Error) as error:
                raise ConfigurationError(f"--meter {file}: no CSV file: {error}") from error
    return {name: _in_order(name, log) for name, log in found.items()}


def _read(lines: Iterable[list[str]], file: Path, found: dict[str, Log]) -> None:
    rows = iter(lines)
    heading = [_UNIT.sub("", each.strip().lower()) for each in next(rows, [])]
    place = {key: heading.index(name) for key, names in _COLUMNS.items() for name in names if name in heading}
    kind = "watt" if "watt" in place else "joules"
    if not {"time", kind} <= place.keys():
        raise ConfigurationError(f"--meter {file}: its columns are {', '.join(heading)}; expected time, watt, name")
    for number, row in enumerate(rows, start=2):
        if not row:
            continue
        where = f"--meter {file}, line {number}"
        if len(row) != len(heading):
            raise ConfigurationError(f"{where}: {len(row)} fields, expected {len(heading)}")
        name = row[place["name"]].strip() if "name" in place else file.stem
        log = found.setdefault(name, Log([], [], kind == "joules"))
        if log.is_counter != (kind == "joules"):
            raise ConfigurationError(f"{where}: {name} has watts in one file and joules in another, expected one kind")
        log.time_s.append(_time_s(row[place["time"]].strip(), where))
        log.values.append(_finite(row[place[kind]].strip().rstrip("WJ "), f"{where}: {kind}"))


def _time_s(text: str, where: str) -> float:
    """Seconds since 1970, as a number or an ISO 8601 time; one without a zone is of UTC."""
    try:
        time = datetime.datetime.fromisoformat(text.replace("/", "-"))  # nvidia-smi: 2026/11/29 20:51:44.123
    except ValueError:
        seconds = _finite(text, f"{where}: time")
    else:
        seconds = (time if time.tzinfo else time.replace(tzinfo=datetime.UTC)).timestamp()
    if not 0 <= seconds < 1e11:
        raise ConfigurationError(f"{where}: time {text!r}, expected seconds since 1970 or an ISO 8601 time")
    return seconds


def _finite(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigurationError(f"{what} {text!r}, expected a finite number")
    return value


def _in_order(name: str, log: Log) -> Log:
    samples = sorted(zip(log.time_s, log.values, strict=True))
    times_s, values = ([sample[place] for sample in samples] for place in (0, 1))
    if len(set(times_s)) < len(times_s):
        raise ConfigurationError(f"--meter: {name} has two samples of one moment, expected a name for each device")
    return Log(times_s, values, log.is_counter)
