"""A results folder of made-up facts."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.facts import write_facts
from jouleswarm.studies.record import Record, write_record
from jouleswarm.studies.run import make_tables
from tests.studies.made_up import SEEDS, paper_facts

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    return load_scenario(ROOT / "scenarios" / "quick.toml")


@pytest.fixture
def paper_results(tmp_path: Path, scenario: Scenario) -> Path:
    """A results folder of `study paper`, facts and record only."""
    return _write(tmp_path / "results", scenario)


@pytest.fixture(scope="session")
def tables(tmp_path_factory: pytest.TempPathFactory, scenario: Scenario) -> Path:
    """The same with its tables."""
    folder = _write(tmp_path_factory.mktemp("tables"), scenario)
    make_tables(folder, kinds=())
    return folder


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory, scenario: Scenario) -> Path:
    """The same with its tables and figures."""
    folder = _write(tmp_path_factory.mktemp("made"), scenario)
    make_tables(folder)
    return folder


def _write(folder: Path, scenario: Scenario) -> Path:
    write_facts(folder / FACTS, paper_facts())
    write_record(folder, Record(study="paper", profile="compact", scenario=scenario, seeds=SEEDS, t0=0))
    return folder
