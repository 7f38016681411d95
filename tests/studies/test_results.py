"""Results in the repository: their tables are what their facts come to."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.studies.catalogue import kind_of
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.facts import read_facts
from jouleswarm.studies.kinds import write_csv_tables
from jouleswarm.studies.record import read_record

ROOT = Path(__file__).parents[2]
COMMITTED = sorted(path.parent for path in ROOT.glob(f"results/*/{FACTS}"))


def made_again(results: Path, into: Path) -> dict[str, bytes]:
    record = read_record(results)
    tables = write_csv_tables(into, kind_of(record.study).outputs(read_facts(results / FACTS), record))
    return {path.name: path.read_bytes() for path in tables}


def committed(results: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in results.glob("*.csv") if path.name != FACTS}


@pytest.fixture(params=[*COMMITTED, None], ids=lambda path: str(path.relative_to(ROOT)) if path else "made up")
def results(request: pytest.FixtureRequest, tables: Path) -> Path:
    """Each results folder of the repository, and a made-up one."""
    folder: Path = request.param or tables
    return folder


def test_committed_tables_are_what_the_committed_facts_come_to(results: Path, tmp_path: Path) -> None:
    assert made_again(results, tmp_path / "again") == committed(results)


def test_a_changed_fact_shows_in_the_tables(tables: Path, paper_results: Path, tmp_path: Path) -> None:
    facts = paper_results / FACTS
    facts.write_text(facts.read_text().replace(",32,30,32,", ",33,30,32,", 1))
    assert made_again(paper_results, tmp_path / "changed") != committed(tables)
