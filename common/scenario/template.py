"""A scenario to begin from, with every field, its default and what it is: `jouleswarm init`."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from jouleswarm.common.scenario.documents import parse_toml
from jouleswarm.common.scenario.environments import LANDMARKS, factory_of
from jouleswarm.common.scenario.reading import SCENARIOS
from jouleswarm.common.scenario.reference import section_of
from jouleswarm.common.scenario.scenario import Scenario

_BASE = "toy"
_WIDTH = 100
_HEAD = """\
# A scenario of your own, as small as the shipped toy.
# It is valid as it is: jouleswarm validate {name}.toml checks it, jouleswarm run {name}.toml runs it.
#
# What stands behind one # is a field's default: take the # away and change it. Behind two stands what the field
# below is. docs/scenarios.md has bounds, and the tables that are left out here.
"""
_TASKS = """
## The tasks, each with robots of its own (federation.robots_per_cluster). A map shows the way to learn:
## E entry, * path, X exit, # obstacle, . floor.
"""


def template(name: str) -> str:
    """A file's text: the shipped toy's values, and all other fields as comments; `name` is the scenario's."""
    given = parse_toml((SCENARIOS / f"{_BASE}.toml").read_text(encoding="utf-8")) | {"name": name}
    given.pop("note", None)  # of the toy alone
    factory: Any = factory_of(LANDMARKS, None)
    tables: dict[str, Any] = dict(factory.sections)
    for field, info in Scenario.model_fields.items():
        model = section_of(info.annotation)
        if model is not None and info.annotation == model:
            tables[field] = model
    parts = [_HEAD.format(name=name), *_fields(Scenario, given, {})]
    for table, model in tables.items():
        parts += [f"\n[{table}]\n", *_fields(model, given.get(table, {}), factory.defaults.get(table, {}))]
    return "".join([*parts, _TASKS, *_tasks(given["tasks"])])


def _fields(model: type[BaseModel], given: Mapping[str, Any], defaults: Mapping[str, Any]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        if section_of(field.annotation) is not None:
            continue
        plain = None if field.is_required() else field.get_default(call_default_factory=True)
        value = given.get(name, defaults.get(name, plain))
        unset = " (unset)" if value is None else ""
        lines = textwrap.wrap(f"{name}{unset}: {field.description}", _WIDTH)
        yield "".join(f"## {line}\n" for line in lines)
        if value is not None:
            yield f"{'' if name in given else '# '}{name} = {_toml(value)}\n"


def _tasks(tasks: list[dict[str, Any]]) -> Iterator[str]:
    for task in tasks:
        yield f'\n[[tasks]]\nid = {task["id"]}\nmap = """\n{task["map"]}"""\n'


def _toml(value: Any) -> str:
    """Text, numbers, truth and lists are written as in JSON."""
    return json.dumps(value, ensure_ascii=False)
