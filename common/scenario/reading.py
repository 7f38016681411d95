"""From a scenario file and its overrides to a `Scenario`, or one line that says what is wrong with them."""

from __future__ import annotations

import contextlib
import copy
import tomllib
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from jouleswarm.common.doors import DOORS, trial_of
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.documents import parse_json, parse_toml
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.environments import LANDMARKS, factory_of, own_model
from jouleswarm.common.scenario.fitting import misfits
from jouleswarm.common.scenario.kept import as_kept
from jouleswarm.common.scenario.mistakes import did_you_mean, one_line, short
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Interface

SCENARIOS = Path(str(files("jouleswarm"))) / "scenarios"


Override = str | tuple[str, object]
"""`section.key=value` (a value is TOML, or plain text), or (section.key, value)."""


def load_scenario(given: str | Path | Mapping[str, Any], overrides: Iterable[Override] = ()) -> Scenario:
    """Read a scenario file and apply overrides.

    A plain name is one that comes with the package: `quick`. A run's manifest.json is a scenario file too: the run's
    own, resolved. What a file would hold may be given itself. Files that a scenario names are looked for beside its
    file; of one that is no file of the user's, in the current folder.

    Raises:
        ConfigurationError: one line saying what is wrong, where, and what was expected.
    """
    if isinstance(given, Mapping):
        data, where, folder, interface = copy.deepcopy(dict(given)), "given as a dict", Path.cwd(), None
    else:
        path = scenario_path(given)
        (data, interface), where, folder = _read(path), str(path), path.parent
        if folder == SCENARIOS:
            folder = Path.cwd()
        elif path.suffix == ".json":
            folder /= DOORS
    for override in overrides:
        apply_override(data, override)
    return scenario_from(data, where, folder, interface)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """What a file holds: a scenario, and its sizes where it is a run's manifest."""
    try:
        text = path.read_text(encoding="utf-8")
        held = parse_json(text) if path.suffix == ".json" else {"scenario": parse_toml(text)}
        data, interface = held["scenario"], held.get("interface")
    except OSError as error:
        raise ConfigurationError(f"scenario {path}: cannot be read ({error.strerror})") from error
    except (KeyError, TypeError, AttributeError) as error:
        raise ConfigurationError(f"scenario {path}: not a run's manifest: {error}") from error
    except ValueError as error:
        expected = "a run's manifest" if path.suffix == ".json" else "valid TOML"
        raise ConfigurationError(f"scenario {path}: not {expected}: {error}") from error
    if not isinstance(data, dict):
        raise ConfigurationError(f"scenario {path}: not a run's manifest: its scenario is {short(data)}")
    return as_kept(data) if path.suffix == ".json" else data, interface


def scenario_path(path: str | Path) -> Path:
    """A scenario's file: of a plain name, such as `quick`, the one that comes with the package.

    Raises:
        ConfigurationError: neither a file nor such a name.
    """
    path = Path(path)
    if path.suffix or len(path.parts) != 1 or path.is_file():
        return path
    if path.name not in (known := scenario_names()):
        told = f"no file here, expected one or a name: {', '.join(known)}{did_you_mean(path.name, known)}"
        raise ConfigurationError(f"scenario {path}: {told}")
    return SCENARIOS / f"{path.name}.toml"


def scenario_names() -> list[str]:
    """Of those that come with the package."""
    return sorted(each.stem for each in SCENARIOS.glob("*.toml"))


def energy_file(path: Path | None) -> list[Override]:
    """The constants of a TOML file's tables [energy] and [[robots]], as overrides of a scenario; of no file none.

    Raises:
        ConfigurationError: it cannot be read, or has something else than these tables; the values are not looked at.
    """
    if path is None:
        return []
    try:
        held = parse_toml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"energy file {path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise ConfigurationError(f"energy file {path}: not valid TOML: {error}") from error
    if not set(held) <= {"energy", "robots"} or not isinstance(held.get("energy", {}), dict):
        raise ConfigurationError(
            f"energy file {path}: has {short(list(held))}, expected tables [energy] and [[robots]] and nothing else"
        )
    robots: list[Override] = [("robots", held["robots"])] if "robots" in held else []
    return [*((f"energy.{key}", value) for key, value in held.get("energy", {}).items()), *robots]


def with_prices(
    scenario: Scenario, overrides: Iterable[Override], where: str, prices_folder: Path | None = None
) -> Scenario:
    """A scenario with overrides of its section energy; nothing else of it is looked at, nor needs to be there.

    Args:
        scenario: stays as it is.
        overrides: `energy.key=value`.
        where: names its origin in errors.
        prices_folder: in which price lists are looked for before the scenario's own.

    Raises:
        ConfigurationError: as `load_scenario`.
    """
    data: dict[str, Any] = {"energy": scenario.energy.model_dump(mode="json")}
    for override in overrides:
        apply_override(data, override)
    try:
        return scenario.at(Energy.model_validate(data["energy"]), prices_folder)
    except ValidationError as error:
        raise ConfigurationError(f"scenario {where}: {one_line(error, [Energy], 'energy.')}") from error


def with_overrides(scenario: Scenario, overrides: Iterable[Override], where: str) -> Scenario:
    """A scenario with overrides; `where` names its origin in errors.

    Raises:
        ConfigurationError: as `load_scenario`.
    """
    data = scenario.model_dump(mode="json")
    for override in overrides:
        apply_override(data, override)
    changed = scenario_from(data, where, scenario.folder)
    changed.known.extend(scenario.known)
    return changed


def scenario_from(
    data: dict[str, Any], where: str, folder: Path | None = None, interface: dict[str, Any] | None = None
) -> Scenario:
    """Validate a scenario given as plain data.

    Args:
        data: of the scenario.
        where: names its origin in errors.
        folder: holds files that it names.
        interface: its sizes, where a run's manifest has them (see `common.scenario.spaces`).

    Raises:
        ConfigurationError: one line saying what is wrong, where, and what was expected.
    """
    try:
        known = None if interface is None else Interface.model_validate(interface)
        scenario = Scenario.model_validate(data, context={"folder": folder, "interface": known})
    except ValidationError as error:
        raise ConfigurationError(f"scenario {where}: {one_line(error, _models(data, folder))}") from error
    if interface is None and (misfit := next(misfits(scenario), None)):  # else it was seen when the run was begun
        raise ConfigurationError(f"scenario {where}: {misfit}")
    try:
        for kind in dict(scenario.named):
            if trial := trial_of(kind):
                trial(scenario)
    except ConfigurationError as error:
        raise ConfigurationError(f"scenario {where}: {error}") from error
    return scenario


def _models(data: Mapping[str, Any], folder: Path | None) -> list[type[BaseModel]]:
    """Whose fields a scenario may have: its own, and its environment's."""
    with contextlib.suppress(ConfigurationError):
        return [Scenario, own_model(factory_of(str(data.get("environment", LANDMARKS)), folder))]
    return [Scenario]


def apply_override(data: dict[str, Any], override: Override) -> None:
    """Change what a scenario's file holds.

    Raises:
        ConfigurationError: it is no `section.key=value`, or its section is none.
    """
    told = override if isinstance(override, str) else "=".join(map(str, override))
    shown = repr(told) if len(told) <= 80 else repr(told[:77]) + "..."
    key, equals, text = told.partition("=")
    if not equals or not key:
        raise ConfigurationError(f"override {shown}: expected section.key=value, for example meta.t0=42")
    *sections, last = key.strip().split(".")
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise ConfigurationError(f"override {shown}: {section!r} is not a section")
    data[last] = _value(text, shown) if isinstance(override, str) else override[1]


def _value(text: str, shown: str) -> Any:
    try:
        return parse_toml(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
    except ValueError as error:
        raise ConfigurationError(f"override {shown}: {error}") from error
