"""Runs listed and side by side: the made-up run of tests/made_up_run.py, whose bill is worked out by hand."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.report.compare import compare_document, compare_lines, compare_table, compared
from jouleswarm.report.document import report_document
from jouleswarm.report.listing import runs_document, runs_table
from jouleswarm.runs.listing import ListedArm, listed
from jouleswarm.runs.summary import summarise


@pytest.fixture
def runs(write_run: Callable[..., Path], facts: Any, tmp_path: Path) -> Path:
    """A folder with a complete run, `a`, and another of seed 8 and t0 4 that was interrupted, `b`."""
    folder = tmp_path / "runs"
    folder.mkdir()
    shutil.move(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)), folder / "a")
    shutil.copytree(folder / "a", folder / "b")
    manifest = json.loads((folder / "b" / "manifest.json").read_text())
    manifest["seed"] = manifest["scenario"]["seed"] = 8
    manifest["scenario"]["meta"]["t0"] = 4
    manifest["started"] = "2024-05-01T13:00:00+00:00"
    (folder / "b" / "manifest.json").write_text(json.dumps(manifest))
    for name in ("summary.json", "meter.jsonl"):
        (folder / "b" / name).unlink()
    return folder


def test_a_folder_is_listed_newest_first_with_what_is_known_of_each_run(runs: Path) -> None:
    (runs / "none").mkdir()
    (runs / "old").mkdir()
    (runs / "old" / "manifest.json").write_text('{"schema": 1}')
    newest, before, old = listed(runs)
    assert (newest.path.name, newest.status, newest.seed) == ("b", "interrupted", 8)
    # Task 1 took 4 rounds by MAML and 10 without, task 2 took 6 and 20.
    assert set(newest.arms) == {ListedArm("maml", 10, None), ListedArm("fl", 30, None)}
    summary = json.loads((runs / "a" / "summary.json").read_text())
    joules = {name: arm["energy_j"]["literal"]["total"] for name, arm in summary["arms"].items()}
    assert {arm.name: arm.joules for arm in before.arms} == joules
    assert (before.status, old.status, "schema 1" in old.why) == ("complete", "unreadable", True)
    with Lock(runs / "b", "somebody"):
        assert listed(runs)[0].status == "running"
    began = datetime(2024, 5, 1, 13, tzinfo=UTC)
    rows = {row[0]: row for row in runs_table([newest, before, old], began + timedelta(minutes=90)).rows}
    assert [rows[name][4] for name in ("b", "a", "old")] == ["2 h", "2 h", None]
    assert rows["b"][5:] in (["maml, fl", "10, 30", "-, -"], ["fl, maml", "30, 10", "-, -"])
    assert runs_document([newest])[0]["started"] == "2024-05-01T13:00:00+00:00"


def test_two_runs_stand_side_by_side_with_what_differs(runs: Path) -> None:
    found = compared([runs / "a", runs / "b"])
    rows = {row[0]: list(row[1:]) for row in compare_table(found).rows}
    assert rows["FL, no transfer: rounds"] == ["30", "30", "1"]
    assert rows["FL, no transfer: tasks learned"] == ["1", "1", "1"]
    # Sidelinks: 2 directed links x 5000 B x 30 rounds, 8 bits each; nobody's counters are left of b.
    assert rows["FL, no transfer: bits"] == ["2.4 Mbit", None, None]
    assert found.differences == {"seed": [7, 8], "meta.t0": [3, 4]}
    told = list(compare_lines(found))
    assert told[-2:] == ["  seed: A 7, B 8", "  meta.t0: A 3, B 4"] or told[-2:] == [
        "  meta.t0: A 3, B 4",
        "  seed: A 7, B 8",
    ]
    first, second = compare_document(found)["runs"]
    assert (first["arms"]["fl"]["bits"], second["arms"]["fl"]["bits"]) == (2.4e6, None)


def test_one_run_alone_is_not_compared(runs: Path) -> None:
    with pytest.raises(ConfigurationError, match="got 1 run, expected 2 to 26"):
        compared([runs / "a"])
    assert list(compare_lines(compared([runs / "a", runs / "a"])))[-1] == "Their scenarios are the same."


def test_a_report_as_a_document_is_the_summary_at_its_prices(runs: Path) -> None:
    summary = json.loads((runs / "a" / "summary.json").read_text())
    assert json.loads(json.dumps(report_document(runs / "a")["summary"])) == summary
    dear = report_document(runs / "a", ["energy.sl_bit_per_j=250e3"], budget="1kJ")
    assert dear["energy"] == {"sl_bit_per_j": 250e3}
    # 2.4 Mbit over sidelinks at 250 kb/J in place of 500 kb/J.
    assert dear["summary"]["arms"]["fl"]["energy_j"]["by_cause"]["sidelink"] == pytest.approx(9.6)
    assert summary["arms"]["fl"]["energy_j"]["by_cause"]["sidelink"] == pytest.approx(4.8)
    (budget,) = dear["tables"]
    assert [row["arm"] for row in budget["rows"]]
