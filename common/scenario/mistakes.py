"""What is wrong with a scenario, in one line that says what was meant instead."""

from __future__ import annotations

import difflib
import inspect
import json
import re
import reprlib
from collections.abc import Iterator, Sequence
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

Models = Sequence[type[BaseModel]]
_SHORT, _CLOSE_IF_SHORT, _CLOSE = 4, 0.5, 0.65


def one_line(error: ValidationError, models: Models, within: str = "") -> str:
    """All that is wrong.

    Args:
        error: of the data.
        models: what was expected: the fields of any of them.
        within: stands before each place.
    """
    parts = []
    for item in error.errors(include_url=False):
        where = within + ".".join(map(str, item["loc"]))
        parts.append(f"{where}: {_told(dict(item), where, models, within)}".removeprefix(": "))
    return "; ".join(parts)


def did_you_mean(name: str, known: Sequence[str], before: str = "") -> str:
    """`; did you mean quick?`, or nothing where no name is close; `before` stands before it."""
    close = difflib.get_close_matches(name, known, 1, _CLOSE_IF_SHORT if len(name) <= _SHORT else _CLOSE)
    return f"; did you mean {before}{close[0]}?" if close else ""


def short(value: object) -> str:
    """A value, cut where it is long."""
    try:
        text = json.dumps(value, default=str)
    except RecursionError:
        text = reprlib.repr(value)
    return text if len(text) < 60 else text[:57] + "..."


def _told(item: dict[str, Any], where: str, models: Models, within: str) -> str:
    kind, got = item["type"], short(item["input"])
    if kind == "extra_forbidden":
        names = names_at(models, item["loc"])
        hint = did_you_mean(str(item["loc"][-1]), names, where.rpartition(".")[0] + "." * ("." in where))
        return f"no such field{hint or '; docs/scenarios.md has all'}"
    if kind in ("tuple_type", "list_type"):
        literal = _list_of(item["input"])
        is_settable = all(isinstance(level, str) for level in item["loc"])
        how = f": {literal} (in a shell: --set '{where}={literal}')" if is_settable and literal else ""
        return f"got {got}, expected a list{how}"
    message = item["msg"].removeprefix("Value error, ")
    return message if kind in ("value_error", "missing") else f"{message}, got {got}"


def names_at(models: Models, place: Sequence[int | str]) -> list[str]:
    """Names of the fields that there are where an error is, as pydantic tells places."""
    found = list(models)
    for level in place[:-1]:  # a place in a list, or a name of the user's, is of the same model
        found = [kind for model in found for kind in _kinds_at(model, level)] or found
    return list(dict.fromkeys(name for model in found for name in model.model_fields))


def _kinds_at(model: type[BaseModel], level: int | str) -> Iterator[type[BaseModel]]:
    if isinstance(level, str) and level in model.model_fields:
        yield from _models_in(model.model_fields[level].annotation)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Those of a table, of each of a list of tables, or of tables by name."""
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models_in(part)


def _list_of(value: object) -> str:
    """The literal of a list that was given as one value, or as a list's text without the quotes; else nothing."""
    if isinstance(value, str) and (words := re.findall(r"[^\s,;\[\]'\"]+", value)):
        return json.dumps(words)
    return json.dumps([value]) if isinstance(value, int | float) else ""
