"""Scenarios of runs and studies from before a field was there mean what they meant."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jouleswarm.common.scenario.kept import as_kept
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.studies.record import read_record

ROOT = Path(__file__).parents[2]


def test_what_a_kept_scenario_says_is_kept_and_what_is_newer_than_it_is_as_it_was_then() -> None:
    data = {"learning": {"epsilon": 0.1}, "meta": {"epsilon": 0.6}}
    assert as_kept(data) == {"learning": {"epsilon": 0.1, "collect": "own"}, "meta": {"epsilon": 0.6}}
    assert data == {"learning": {"epsilon": 0.1}, "meta": {"epsilon": 0.6}}
    said = {"learning": {"collect": "guide"}}
    assert as_kept(said) == said
    assert as_kept({"learning": "damaged"}) == {"learning": "damaged"}


@pytest.mark.parametrize("study", sorted(path.parent.name for path in ROOT.glob("results/*/study.json")))
def test_robots_of_committed_studies_collected_by_the_rules_of_then(study: str) -> None:
    folder = ROOT / "results" / study
    said = json.loads((folder / "study.json").read_text())["scenario"]["learning"]
    scenario = read_record(folder).scenario
    if "collect" not in said:
        assert scenario.learning.collect == "own"
        assert (scenario.learning.epsilon, scenario.learning.starts) == (0.1, "area")
        assert (scenario.meta_epsilon, scenario.meta_starts) == (0.6, "anywhere")


def test_an_older_run_s_manifest_given_as_a_scenario_means_what_it_meant(tmp_path: Path) -> None:
    scenario = load_scenario("toy").model_dump(mode="json")
    del scenario["learning"]["collect"]
    (tmp_path / "manifest.json").write_text(json.dumps({"scenario": scenario}))
    assert load_scenario(tmp_path / "manifest.json").learning.collect == "own"
    changed = load_scenario(tmp_path / "manifest.json", ["learning.collect=guide"])
    assert changed.learning.collect == "guide"
