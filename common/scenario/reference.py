"""Every field of a scenario, as a page: `python -m jouleswarm.common.scenario.reference > docs/scenarios.md`."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel

from jouleswarm.common.scenario.environments import LANDMARKS, factory_of
from jouleswarm.common.scenario.scenario import Scenario

HEAD = """# Scenarios

A scenario is one TOML file, checked before anything starts: what is unknown, out of bounds or does not fit together is
refused with one line and exit code 2. This page is made from the models that check it, by `python -m
jouleswarm.common.scenario.reference`. `--set section.key=value` changes any field of a command's scenario. Seven
come with the package, by name:

| scenario | what |
|---|---|
| `quick` | the paper's 12 robots and 6 tasks with a compact network |
| `paper` | the full-size DeepMind network: 1,391,268 parameters, 5,565,072 bytes; t0 = 210 |
| `hexapod` | the authors' own grid and reward table |
| `toy` | 2 tasks, 2 robots each, a tiny network: a smoke test in seconds, too small to conclude anything from |
| `frozenlake` | Gymnasium's FrozenLake, a map for each task: numbers as observations |
| `cartpole` | Gymnasium's CartPole, a pole length for each task: vectors |
| `minigrid` | MiniGrid: images; needs `pip install jouleswarm[minigrid]` |

`jouleswarm init mine.toml` writes one of your own, valid as it is, every field in it with its default. For an editor
that completes and checks TOML (taplo, Even Better TOML): `jouleswarm schema > scenario.schema.json`, and as the
scenario's first line `#:schema ./scenario.schema.json`.

A task of the landmarks is a drawing:

```toml
[[tasks]]
id = 7
map = \"\"\"
. . E . .
. . * . .
. * * # .
. X . . .
\"\"\"          # E entry, * path, X exit, # obstacle, . floor
```

Robots are numbered from 1 in the order of the tasks. What the methods and encodings are: `docs/methods.md`.
"""
TABLE = "| field | default | values | what |\n|---|---|---|---|\n"

Schema = Mapping[str, Any]


def reference() -> str:
    """The page."""
    schema = Scenario.model_json_schema()
    parts = [HEAD, "## The scenario\n", TABLE + "".join(_rows(Scenario, schema, schema))]
    for name, field in Scenario.model_fields.items():
        if (model := section_of(field.annotation)) is None:
            continue
        title = f"[[{name}]]" if model is not field.annotation else f"[{name}]"
        parts.append(_section(title, model, schema))
        for inner, within in model.model_fields.items():
            if (part := section_of(within.annotation)) is not None:
                named = ".NAME" if part is not within.annotation else ""
                parts.append(_section(f"[{name}.{inner}{named}]", part, schema))
    factory: Any = factory_of(LANDMARKS, None)
    parts += [_own(f"[{name}]", model) for name, model in factory.sections.items()]
    return "\n".join([*parts, _own("[[tasks]]", factory.task)])


def _section(title: str, model: type[BaseModel], schema: Schema) -> str:
    doc = inspect.cleandoc(model.__doc__ or "")
    return f"## `{title}`\n\n{doc}\n\n{TABLE}{''.join(_rows(model, schema['$defs'][model.__name__], schema))}"


def _own(title: str, model: type[BaseModel]) -> str:
    """A table that is there with the landmarks only, or what they add to one."""
    schema = model.model_json_schema()
    doc = inspect.cleandoc(model.__doc__ or "")
    return f"## `{title}` of the landmarks\n\n{doc}\n\n{TABLE}{''.join(_rows(model, schema, schema))}"


def section_of(annotation: Any) -> type[BaseModel] | None:
    """The model of a table, or of each of a list of tables."""
    for kind in (annotation, *get_args(annotation)):
        if inspect.isclass(kind) and issubclass(kind, BaseModel):
            return kind
    return None


def _rows(model: type[BaseModel], schema: Schema, whole: Schema) -> Iterator[str]:
    for name, field in model.model_fields.items():
        if section_of(field.annotation) is None:
            told = schema["properties"][name]
            default = "required" if field.is_required() else _default(told.get("default"))
            cells = (f"`{name}`", default, _values(told, whole), told.get("description", ""))
            yield f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |\n"


def _default(value: object) -> str:
    return "" if value is None else f"`{json.dumps(value, ensure_ascii=False)}`"


def _values(told: Schema, whole: Schema) -> str:
    """What a field may be, in words, from its JSON schema."""
    if "$ref" in told:
        return _values(whole["$defs"][told["$ref"].rsplit("/", 1)[-1]], whole)
    if "anyOf" in told:
        return " or ".join(_values(each, whole) for each in told["anyOf"] if each.get("type") != "null")
    if "const" in told or "enum" in told:
        return ", ".join(f"`{json.dumps(each)}`" for each in told.get("enum", [told.get("const")]))
    if told.get("type") == "array":
        if "prefixItems" in told:
            return f"({'; '.join(_values(each, whole) for each in told['prefixItems'])})"
        return f"list of {_values(told.get('items', {}), whole)}"
    return _plain(told)


def _plain(told: Schema) -> str:
    names = {"integer": "whole number", "number": "number", "boolean": "true or false", "string": "text"}
    kind = names.get(told.get("type", ""), "anything")
    words = (("", "minimum"), ("above ", "exclusiveMinimum"), ("", "maximum"), ("below ", "exclusiveMaximum"))
    bounds = [f"{word}{_number(told[key])}" for word, key in words if key in told]
    return f"{kind}, {' to '.join(bounds)}" if bounds else kind


def _number(value: float) -> str:
    return f"{value:_}" if isinstance(value, int) else f"{value:g}"


if __name__ == "__main__":
    print(reference(), end="")
