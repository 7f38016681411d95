"""What a scenario meant that an earlier version wrote down."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.scenario.reading import load_scenario, scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.settings import Camera, camera_of
from jouleswarm.studies.record import Record, read_record, write_record

ROOT = Path(__file__).parents[2]
TOY, RESULTS = ROOT / "scenarios" / "toy.toml", ROOT / "results"


def meaning(scenario: Scenario) -> tuple[str, str]:
    """The two settings that came after the first stored scenarios."""
    return camera_of(scenario).draw, scenario.federation.window


@pytest.fixture
def older() -> dict[str, Any]:
    """The toy as it was written down before there were these settings."""
    data = load_scenario(TOY).model_dump(mode="json")
    del data["camera"]["draw"], data["federation"]["window"]
    return data


def test_a_run_of_before_means_what_it_meant_and_a_scenario_of_today_what_today_is_meant(
    older: dict[str, Any], tmp_path: Path
) -> None:
    (path := tmp_path / "manifest.json").write_text(json.dumps({"scenario": older}))
    assert meaning(load_scenario(path)) == ("frame", "partial")
    assert meaning(load_scenario(path, ["camera.draw=input"])) == ("input", "partial")
    assert meaning(scenario_from(older, "today")) == (Camera().draw, "full")


def test_a_run_of_today_means_what_it_says(tmp_path: Path) -> None:
    for draw in ("input", "frame"):
        data = load_scenario(TOY, [f"camera.draw={draw}"]).model_dump(mode="json")
        (path := tmp_path / "manifest.json").write_text(json.dumps({"scenario": data}))
        assert meaning(load_scenario(path)) == (draw, "full")


def test_a_study_of_before_means_what_it_meant(older: dict[str, Any], tmp_path: Path) -> None:
    write_record(tmp_path, Record(study="paper", profile="x", scenario=load_scenario(TOY), seeds=(1,), t0=3))
    held = json.loads((path := tmp_path / "study.json").read_text())
    path.write_text(json.dumps({**held, "scenario": older}))
    assert meaning(read_record(tmp_path).scenario) == ("frame", "partial")


@pytest.mark.parametrize("study", sorted(path.parent.name for path in RESULTS.glob("*/study.json")))
def test_robots_of_committed_studies_collected_by_the_rules_of_then(study: str) -> None:
    folder = RESULTS / study
    said = json.loads((folder / "study.json").read_text())["scenario"]["learning"]
    scenario = read_record(folder).scenario
    if "collect" not in said:
        assert scenario.learning.collect == "own"
        assert (scenario.learning.epsilon, scenario.learning.starts) == (0.1, "area")
        assert (scenario.meta_epsilon, scenario.meta_starts) == (0.6, "anywhere")


def test_robots_of_an_older_run_collect_as_they_did(tmp_path: Path) -> None:
    scenario = load_scenario("toy").model_dump(mode="json")
    del scenario["learning"]["collect"]
    (tmp_path / "manifest.json").write_text(json.dumps({"scenario": scenario}))
    assert load_scenario(tmp_path / "manifest.json").learning.collect == "own"
    changed = load_scenario(tmp_path / "manifest.json", ["learning.collect=guide"])
    assert changed.learning.collect == "guide"
