"""Other prices for what has been run, as its operator names them; nothing is trained again."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import ValidationError

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import Override, with_prices
from jouleswarm.common.scenario.scenario import Scenario

Beta = float | Literal["measured"]
"""What `energy.beta` may be: cost of an exact meta-gradient over a first-order one, 1 or more, or the measured one."""


class _Kind(NamedTuple):
    """How a price is told and turned into a field of `Energy`, which bounds it."""

    expected: str
    factor: float = 1.0


_EFFICIENCY = _Kind("a number from 1e-09 to 1e+12, in kb/J", factor=1e3)
_INTENSITY = _Kind("a number of 0 or more, up to 1e+06, in gCO2e a kWh")
_BETA = _Kind("a number of 1 or more, up to 1e+06")
_SHORT = {
    "ul": ("ul_bit_per_j", _EFFICIENCY),
    "sl": ("sl_bit_per_j", _EFFICIENCY),
    "dl": ("dl_bit_per_j", _EFFICIENCY),
    "pue": ("pue", _Kind("a number of 1 or more, up to 1000")),
    "beta": ("beta", _BETA),
    "carbon_datacenter": ("datacenter_g_per_kwh", _INTENSITY),
    "carbon_robots": ("robots_g_per_kwh", _INTENSITY),
}
_WORDS = {field: (name.replace("_", "-"), kind.factor) for name, (field, kind) in _SHORT.items()}


@dataclass(frozen=True)
class Prices:
    """The prices that have short names; None keeps the run's own."""

    ul: float | None = None  # E_UL, kb/J (1 kb = 1000 bit)
    sl: float | None = None  # E_SL, kb/J
    dl: float | None = None  # E_DL, kb/J; not set anywhere, it is E_UL
    pue: float | None = None  # gamma
    beta: Beta | None = None
    carbon_datacenter: float | None = None  # gCO2e a kWh
    carbon_robots: float | None = None  # gCO2e a kWh
    via_base_station: bool = False  # price sidelinks as up to the base station and down; False keeps the run's own

    @property
    def changes(self) -> list[Override]:
        """The same as changes of a scenario.

        Raises:
            ConfigurationError: a value beyond what a scenario may have there.
        """
        given = {name: getattr(self, name) for name in _SHORT if getattr(self, name) is not None}
        changes: list[Override] = [(f"energy.{_SHORT[name][0]}", _checked(name, given[name])) for name in given]
        return [*changes, ("energy.sidelink", "via_base_station")] if self.via_base_station else changes


def parse_beta(text: str) -> Beta:
    """Beta as it stands on a command line.

    Raises:
        ConfigurationError: it is no number of 1 or more, nor "measured".
    """
    if text == "measured":
        return "measured"
    try:
        value = float(text)
    except ValueError:
        raise ConfigurationError(f"--beta {text}: expected {_BETA.expected}, or measured") from None
    _checked("beta", value)
    return value


def reprice(scenario: Scenario, changes: Iterable[Override], where: str) -> tuple[Scenario, str]:
    """A scenario at other prices, and what these put into file names: "" for the same prices.

    Price lists and tables that are named anew are looked for in the current folder, before those that a run has kept.

    Args:
        scenario: of what has been run.
        changes: of its section energy.
        where: names its origin in errors.

    Raises:
        ConfigurationError: a change of something else, or to what a scenario may not have there.
    """
    held = list(changes)
    fields = changed_fields(held)
    folder = Path.cwd() if {"prices", "links", "carbon_by_hour"} & {*fields} else None
    other = with_prices(scenario, held, where, folder)
    return other, "" if other.energy == scenario.energy else words_of(other.energy, fields)


def changed_fields(changes: Iterable[Override]) -> list[str]:
    """Which constants of the section energy are changed.

    Raises:
        ConfigurationError: a change of something else.
    """
    fields = []
    for each in changes:
        key = (each if isinstance(each, str) else each[0]).partition("=")[0].strip()
        if not key.startswith("energy."):
            raise ConfigurationError(f"--set {each}: expected energy.KEY=VALUE; anything else needs another run")
        fields.append(key.removeprefix("energy."))
    return list(dict.fromkeys(fields))


def words_of(energy: Energy, fields: Iterable[str]) -> str:
    """What changed constants put into file names."""
    return "".join(f"-{_word(field, _at(energy, field))}" for field in fields)


def _checked(name: str, value: float | Literal["measured"]) -> float | Literal["measured"]:
    """A price in the scenario's own unit, checked as in a scenario."""
    field, kind = _SHORT[name]
    scaled = value if value == "measured" else value * kind.factor
    try:
        Energy.model_validate({field: scaled})
    except ValidationError:
        raise ConfigurationError(f"--{name.replace('_', '-')} {value:g}: expected {kind.expected}") from None
    return scaled


def _at(energy: Energy, field: str) -> object:
    """What stands at a key such as `distance.base_station_m` or `kinds.jetson.pk_w`."""
    found: Any = energy
    for part in field.split("."):
        found = found[part] if isinstance(found, dict) else getattr(found, part)
    return found


def _word(field: str, value: object) -> str:
    """A price as it stands in file names."""
    if field == "sidelink":
        return str(value).replace("_", "-")
    name, factor = _WORDS.get(field, (field.replace("_", "-"), 1.0))
    told = f"{value / factor:g}" if isinstance(value, float) else value
    told = "-".join(map(str, value)) if isinstance(value, tuple) else told
    word = f"{name}{told}" if isinstance(value, float) else f"{name}-{told}"
    return re.sub(r"[^A-Za-z0-9.+-]+", "-", word)[:100]
