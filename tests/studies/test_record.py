"""A study's folder needs nothing but itself: the user's own files are kept with it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.facts import write_facts
from jouleswarm.studies.record import Record, read_record, write_record
from jouleswarm.studies.run import make_tables, reprice
from tests.studies.made_up import task_fact

EXAMPLES = Path(__file__).parents[2] / "examples"
MINE = """
name = "mine"
environment = "corridor:Corridor"
methods = ["fl", "median:Median"]
federation = { topology = "edges.csv" }
tasks = [{ id = 1, kwargs = { right = true } }, { id = 2, kwargs = { right = false } }]
"""


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Facts and record of a study of own methods, an own environment and own edges, whose files are gone."""
    source, folder = tmp_path / "source", tmp_path / "results"
    source.mkdir()
    (source / "mine.toml").write_text(MINE)
    (source / "edges.csv").write_bytes("robot,neighbour\n1,2\n3,4\n".encode("utf-8-sig"))
    for name in ("corridor.py", "median.py"):
        shutil.copy(EXAMPLES / name, source / name)
    write_facts(
        folder / FACTS, [task_fact(Arm(name, name, 0), task, 9) for name in ("fl", "median") for task in (1, 2)]
    )
    scenario = load_scenario(source / "mine.toml")
    write_record(folder, Record(study="baselines", profile="compact", scenario=scenario, seeds=(1,), t0=0))
    kept = {name: (source / name).read_bytes() for name in ("corridor.py", "edges.csv", "median.py")}
    assert {path.name: path.read_bytes() for path in (folder / "doors").iterdir()} == kept
    shutil.rmtree(source)
    monkeypatch.chdir(tmp_path)
    return folder


def test_tables_and_figures_are_made_from_elsewhere_once_the_users_files_are_gone(results: Path) -> None:
    make_tables(results, ["svg"])
    assert "coordinate-wise median" in (results / "baselines.svg").read_text()
    assert "| median |" in (results / "baselines.md").read_text()


def test_a_study_of_own_methods_is_moved_and_priced_again(results: Path, tmp_path: Path) -> None:
    moved = results.rename(tmp_path / "moved")
    reprice(moved, ["energy.pue=2"], tmp_path / "again", kinds=())
    shutil.rmtree(moved)
    scenario = read_record(tmp_path / "again").scenario
    assert (scenario.method_names, scenario.energy.pue) == (("fl", "median"), 2)
    assert scenario.edges == {1: ((1, 2),), 2: ((3, 4),)}
    make_tables(tmp_path / "again", kinds=())
