"""A scenario to begin from, the shelf of scenarios, and their JSON Schema."""

from __future__ import annotations

import json
import re
from pathlib import Path

import jsonschema
import pytest

from jouleswarm.common.scenario.documents import parse_toml
from jouleswarm.common.scenario.reading import SCENARIOS, scenario_from
from jouleswarm.common.scenario.schema import schema
from jouleswarm.common.scenario.shelf import on_shelf
from jouleswarm.common.scenario.template import template

ROOT = Path(__file__).parents[2]
FILES = [*sorted(SCENARIOS.glob("*.toml")), *sorted((ROOT / "examples").glob("*.toml"))]


def test_the_template_is_the_toy_and_its_comments_are_the_defaults() -> None:
    text = template("mine")
    mine = scenario_from(parse_toml(text), "mine")
    toy = scenario_from(parse_toml((SCENARIOS / "toy.toml").read_text()), "toy")
    assert mine.model_dump() == toy.model_dump() | {"name": "mine", "note": ""}
    uncommented = re.sub(r"^# (?=\w+ = )", "", text, flags=re.M)
    assert uncommented.count("\n# ") < 5  # of its head
    assert scenario_from(parse_toml(uncommented), "mine").model_dump() == mine.model_dump()


def test_the_shelf_has_the_packages_scenarios_and_those_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("#:schema ./scenario.schema.json\n" + template("mine"))
    (tmp_path / "bare.toml").write_text('name = "bare"\n[[tasks]]\nid = 1\n')
    (tmp_path / "energy.toml").write_text("[energy]\npue = 1.5\n")
    (tmp_path / "torn.toml").write_text("[")
    found = {each.name: each for each in on_shelf(tmp_path)}
    assert {"toy", "quick", "paper"} < found.keys()
    assert found.keys() - {path.stem for path in SCENARIOS.glob("*.toml")} == {"mine.toml", "bare.toml"}
    assert (found["mine.toml"].what, found["mine.toml"].tasks) == (
        "A scenario of your own, as small as the shipped toy.",
        2,
    )
    assert found["bare.toml"].what == "name bare"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_scenario_is_valid_by_the_schema(path: Path) -> None:
    found = parse_toml(path.read_text())
    jsonschema.validate(json.loads(json.dumps(found)), schema())


@pytest.mark.parametrize("wrong", ["[meta]\nt9 = 3\n", "[world]\nrows = 0\n", 'methods = "fl"\n'])
def test_a_mistake_is_one_by_the_schema_too(wrong: str) -> None:
    given = parse_toml((SCENARIOS / "toy.toml").read_text()) | parse_toml(wrong)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(json.loads(json.dumps(given)), schema())
