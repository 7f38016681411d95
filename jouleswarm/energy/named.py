"""Robots that a table calls by name: they get the numbers that constants are given by. Pure."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from jouleswarm.common.errors import ConfigurationError

_COLUMNS = ("robot", "to")
CENTER = "datacenter"
"""Nobody's name: what a table calls the data center."""


def numbers_of(names: Collection[str]) -> dict[str, int]:
    """The number that each goes by: the one at its end; where those are not all there, different and from 1 on, from 1
    in the order of those numbers and then of the names."""
    numbers = _own(names)
    if len(set(numbers.values()) - {0}) < len(names):
        order = sorted(names, key=lambda name: (numbers.get(name, 0), name))
        return {name: number for number, name in enumerate(order, start=1)}
    return numbers


def _own(names: Iterable[str]) -> dict[str, int]:
    return {name: int(found[0]) for name in names if (found := re.search(r"(?<![0-9])[0-9]{1,6}$", name))}


def with_numbers(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows whose columns robot and to have numbers in place of names: `client-3` is robot 3.

    Where names do not all end in a number of their own from 1 on, robots are numbered from 1 in the order of those
    numbers and then of the names.

    Raises:
        ConfigurationError: then some robots must not have numbers already.
    """
    cells = {str(row[column]) for row in rows for column in _COLUMNS if row.get(column) is not None}
    names = {cell for cell in cells if any(map(str.isalpha, cell))} - {CENTER}
    numbers, others = numbers_of(names), sorted(cells - names - {CENTER})
    if others and numbers != _own(names):
        raise ConfigurationError(
            f"robots {min(names)} and {others[0]}: by name and by number, expected names that end in numbers of "
            "their own, or one of the two"
        )
    return [
        {key: numbers.get(str(cell), cell) if key in _COLUMNS else cell for key, cell in row.items()} for row in rows
    ]
