"""From a scenario file and its overrides to a `Scenario`, or one line that says what is wrong with them."""

from __future__ import annotations

import copy
import json
import reprlib
import tomllib
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.documents import parse_json, parse_toml
from jouleswarm.common.scenario.fitting import misfits
from jouleswarm.common.scenario.scenario import Scenario

DOORS = "doors"
"""Folder of a run directory with the user's files that came in by doors."""
SCENARIOS = Path(str(files("jouleswarm"))) / "scenarios"


def load_scenario(
    given: str | Path | Mapping[str, Any], overrides: Iterable[str | tuple[str, object]] = ()
) -> Scenario:
    """Read a scenario file and apply `section.key=value` overrides (values are TOML, or plain text; or pairs).

    A plain name is one that comes with the package: `quick`. A run's manifest.json is a scenario file too: the run's
    own, resolved. What a file would hold may be given itself. Files that a scenario names are looked for beside its
    file; of one that is no file of the user's, in the current folder.

    Raises:
        ConfigurationError: one line saying what is wrong, where, and what was expected.
    """
    if isinstance(given, Mapping):
        data, where, folder = copy.deepcopy(dict(given)), "given as a dict", Path.cwd()
    else:
        path = scenario_path(given)
        data, where, folder = _read(path), str(path), path.parent
        if path.parent == SCENARIOS:
            folder = Path.cwd()
        elif path.suffix == ".json":
            folder = path.parent / DOORS
    for override in overrides:
        _apply(data, override)
    return scenario_from(data, where, folder)


def _read(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
        data = parse_json(text)["scenario"] if path.suffix == ".json" else parse_toml(text)
    except OSError as error:
        raise ConfigurationError(f"scenario {path}: cannot be read ({error.strerror})") from error
    except (KeyError, TypeError) as error:
        raise ConfigurationError(f"scenario {path}: not a run's manifest: {error}") from error
    except ValueError as error:
        expected = "a run's manifest" if path.suffix == ".json" else "valid TOML"
        raise ConfigurationError(f"scenario {path}: not {expected}: {error}") from error
    if not isinstance(data, dict):
        raise ConfigurationError(f"scenario {path}: not a run's manifest: its scenario is {_short(data)}")
    return data


def scenario_path(path: str | Path) -> Path:
    """A scenario's file: of a plain name, such as `quick`, the one that comes with the package."""
    path = Path(path)
    if path.suffix or len(path.parts) != 1 or path.exists():
        return path
    if path.name not in (known := sorted(each.stem for each in SCENARIOS.glob("*.toml"))):
        raise ConfigurationError(f"scenario {path}: expected a file, or one of {', '.join(known)}")
    return SCENARIOS / f"{path.name}.toml"


def with_overrides(
    scenario: Scenario, overrides: Iterable[str | tuple[str, object]], where: str, prices_folder: Path | None = None
) -> Scenario:
    """A scenario with `section.key=value` overrides, as text or as (section.key, value).

    Args:
        scenario: stays as it is.
        overrides: one after the other.
        where: names its origin in errors.
        prices_folder: in which price lists are looked for before the scenario's own.

    Raises:
        ConfigurationError: as `load_scenario`.
    """
    data = scenario.model_dump(mode="json")
    for override in overrides:
        _apply(data, override)
    return scenario_from(data, where, scenario.folder, prices_folder)


def scenario_from(
    data: dict[str, Any], where: str, folder: Path | None = None, prices_folder: Path | None = None
) -> Scenario:
    """Validate a scenario given as plain data; `where` names its origin in errors, `folder` holds files it names.

    Raises:
        ConfigurationError: one line saying what is wrong, where, and what was expected.
    """
    try:
        scenario = Scenario.model_validate(data, context={"folder": folder, "prices_folder": prices_folder})
    except ValidationError as error:
        raise ConfigurationError(f"scenario {where}: {_one_line(error)}") from error
    if misfit := next(misfits(scenario), None):
        raise ConfigurationError(f"scenario {where}: {misfit}")
    return scenario


def _apply(data: dict[str, Any], override: str | tuple[str, object]) -> None:
    told = override if isinstance(override, str) else "=".join(map(str, override))
    shown = repr(told) if len(told) <= 80 else repr(told[:77]) + "..."
    key, equals, _ = told.partition("=")
    if not equals or not key:
        raise ConfigurationError(f"override {shown}: expected section.key=value, for example meta.t0=42")
    *sections, last = key.strip().split(".")
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise ConfigurationError(f"override {shown}: {section!r} is not a section")
    data[last] = _value(told.partition("=")[2], shown) if isinstance(override, str) else override[1]


def _value(text: str, shown: str) -> Any:
    try:
        return parse_toml(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
    except ValueError as error:
        raise ConfigurationError(f"override {shown}: {error}") from error


def _one_line(error: ValidationError) -> str:
    parts = []
    for item in error.errors(include_url=False):
        where = ".".join(str(level) for level in item["loc"])
        got = "" if item["type"] in ("value_error", "missing", "extra_forbidden") else f", got {_short(item['input'])}"
        parts.append(f"{where}: {item['msg'].removeprefix('Value error, ')}{got}".removeprefix(": "))
    return "; ".join(parts)


def _short(value: object) -> str:
    try:
        text = json.dumps(value, default=str)
    except RecursionError:
        text = reprlib.repr(value)
    return text if len(text) < 60 else text[:57] + "..."
