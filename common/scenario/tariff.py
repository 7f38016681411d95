"""Prices by themselves: constants and price lists for counts of experiments that are no scenario here."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from jouleswarm.common.doors import Kind, enter
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import read_links
from jouleswarm.common.scenario.mistakes import one_line
from jouleswarm.common.scenario.reading import Override, apply_override, energy_file
from jouleswarm.common.scenario.robots import Robot
from jouleswarm.common.scenario.sections import Section


class _Held(Section):
    energy: Energy = Energy()
    robots: tuple[Robot, ...] = Field((), max_length=100_000)


@dataclass(frozen=True)
class Tariff:
    """What a scenario would have of prices."""

    energy: Energy
    folder: Path
    """Price lists and a table of links are looked for here."""
    is_by_robot: bool
    """Whether a robot or a link has a constant of its own, so that it matters who did something."""

    def open(self, kind: Kind, name: str) -> Any:
        """As of a scenario."""
        return enter(kind, name, self.folder)


def read_tariff(path: Path | None, changes: Iterable[Override], robots: Collection[int]) -> Tariff:
    """The tables [energy] and [[robots]] of a TOML file, or else the paper's Table I, with changes `energy.key=value`.

    Raises:
        ConfigurationError: one line that says what is wrong; a robot or a link's end is none of `robots`.
    """
    folder = path.parent if path else Path.cwd()
    return tariff_of([*energy_file(path), *changes], folder, robots, _where(path))


def checked_tariff(path: Path | None, changes: Iterable[Override]) -> tuple[Tariff, dict[str, Any]]:
    """The same before there are any counts, and its tables as plain data, resolved; robots and links are not looked at.

    Raises:
        ConfigurationError: one line that says what is wrong.
    """
    held = _held([*energy_file(path), *changes], _where(path))
    tariff = Tariff(held.energy, path.parent if path else Path.cwd(), bool(held.robots or held.energy.links))
    return tariff, held.model_dump(mode="json", exclude_none=True)


def tariff_of(changes: Iterable[Override], folder: Path, robots: Collection[int], where: str) -> Tariff:
    """The paper's Table I with changes `energy.key=value` and (robots, a list); price lists and a table of links are
    looked for in `folder`, and `where` names the origin in errors.

    Raises:
        ConfigurationError: as `read_tariff`.
    """
    held = _held(changes, where)
    ids = [robot.id for robot in held.robots]
    if wrong := [robot for robot in ids if robot not in robots or ids.count(robot) > 1]:
        told = f"of {sorted(robots)[0]} to {sorted(robots)[-1]}, those of the counts" if robots else "no row names one"
        raise ConfigurationError(f"{where}: robot {wrong[0]}: expected each once, and {told}")
    if held.energy.links is not None and not robots:
        raise ConfigurationError(f"{where}: energy.links is given and no row names a robot, expected who did what")
    links = None if held.energy.links is None else read_links(folder / held.energy.links, robots)
    energy = held.energy.for_fleet(held.robots, links)
    return Tariff(energy, folder, bool(held.robots) or links is not None)


def _where(path: Path | None) -> str:
    return f"energy file {path}" if path else "prices"


def _held(changes: Iterable[Override], where: str) -> _Held:
    data: dict[str, Any] = {}
    for change in changes:
        apply_override(data, change)
    try:
        return _Held.model_validate(data)
    except ValidationError as error:
        raise ConfigurationError(f"{where}: {one_line(error, [_Held])}") from error
