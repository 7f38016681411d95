"""A results folder of made-up facts."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.scenario import Scenario, load_scenario
from studies.engine import FACTS
from studies.facts import write_facts
from studies.record import Record, write_record
from tests.studies.made_up import SEEDS, paper_facts

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    return load_scenario(ROOT / "scenarios" / "quick.toml")


@pytest.fixture
def paper_results(tmp_path: Path, scenario: Scenario) -> Path:
    """A results folder of `study paper`, facts and record only."""
    folder = tmp_path / "results"
    write_facts(folder / FACTS, paper_facts())
    write_record(folder, Record(study="paper", profile="compact", scenario=scenario, seeds=SEEDS, t0=0))
    return folder
