"""The JSON Schema of a scenario file, for editors: completion, meanings and mistakes as one types."""

from __future__ import annotations

from typing import Any

from jouleswarm.common.scenario.environments import LANDMARKS, factory_of
from jouleswarm.common.scenario.scenario import Scenario

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema() -> dict[str, Any]:
    """Of the core's tables, and of those of the landmarks. An environment of the user's own may have others."""
    found = Scenario.model_json_schema(mode="validation")
    factory: Any = factory_of(LANDMARKS, None)
    for name, model in factory.sections.items():
        _add(found, name, model.model_json_schema(), found["properties"])
    task = found["$defs"]["Task"]["properties"]
    for name, told in factory.task.model_json_schema()["properties"].items():
        task.setdefault(name, told)
    return {"$schema": DIALECT, "title": "A scenario of JouleSwarm", **{k: v for k, v in found.items() if k != "title"}}


def _add(found: dict[str, Any], name: str, model: dict[str, Any], into: dict[str, Any]) -> None:
    found["$defs"].update(model.pop("$defs", {}))
    into[name] = model
