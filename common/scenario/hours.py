"""A user's table of carbon intensity by hour."""

from __future__ import annotations

import csv
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.bounds import CarbonIntensity

_HEAD = ["hour", "g_per_kwh"]
_MOST_HOURS = 366 * 24
_INTENSITY = TypeAdapter[float](CarbonIntensity)


def read_hours(path: Path) -> tuple[float, ...]:
    """gCO2e a kWh of each hour from 0 on, say of a day or of a year; after the last one the first comes again.

    Raises:
        ConfigurationError: it cannot be read, an hour is missing or out of order, or an intensity is out of bounds.
    """
    where, found = f"energy.carbon_by_hour {path}", list[float]()
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            if (head := next(reader, [])) != _HEAD:
                got = ",".join(head)
                raise ConfigurationError(f"{where}: its first line is {got!r:.80}, expected {','.join(_HEAD)}")
            for cells in reader:
                if len(cells) != len(_HEAD) or cells[0].strip() != str(len(found)) or len(found) == _MOST_HOURS:
                    got, most = ",".join(cells), _MOST_HOURS
                    expected = f"hour {len(found)} and its intensity, {most} hours at most"
                    raise ConfigurationError(f"{where}, line {reader.line_num}: got {got!r:.80}, expected {expected}")
                found.append(_INTENSITY.validate_python(cells[1]))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigurationError(
            f"{where}, line {reader.line_num}: {first['msg']}, got {first['input']!r:.60}"
        ) from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"{where}: cannot be read ({error})") from error
    if not found:
        raise ConfigurationError(f"{where}: has no hour, expected one a line, from 0")
    return tuple(found)
