"""Measured joules on their way from a process's report into the run directory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.bus.bus import MemoryHub
from jouleswarm.common.bus.reporter import MeterReport
from jouleswarm.common.meter.joules import JoulesRow
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import encode_json
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.runs.directory import RunDirectory

RUN = "r"


@pytest.fixture
def scenario() -> Scenario:
    return scenario_from(
        {
            "name": "t", "methods": ["fl"], "world": {"rows": 3, "cols": 2}, "bus": {"connect_timeout_s": 0.3},
            "measure": {"energy": True, "tdp_w": 20, "cores": 2}, "tasks": [{"id": 1, "map": "E . \n * . \n X ."}],
        },
        "test",
    )  # fmt: skip


def drawn(client: str, activity: str, joules: float, how: str = "rapl") -> JoulesRow:
    held = {"phase": "fl", "arm": "fl", "activity": activity, "seconds": 2, "cpu_s": 1, "joules": joules, "how": how}
    return JoulesRow.model_validate({"client": client, "role": "robot", **held})


def recorded(scenario: Scenario, path: Path, reports: dict[str, list[JoulesRow]], state: Path) -> Recorder:
    hub = MemoryHub()
    recorder = Recorder(hub.connect("recorder"), scenario, RUN, RunDirectory(path), state)
    others = hub.connect("others")
    for client, joules in reports.items():
        report = MeterReport(client=client, rows=[], rounds=[], joules=joules)
        others.publish(topics.meter_report(RUN, client), encode_json(report))
    recorder.pump(0.2)
    recorder.close("interrupted")
    return recorder


def test_what_processes_measure_lands_in_a_file_and_a_sum_by_role_way_and_activity(
    scenario: Scenario, tmp_path: Path
) -> None:
    # Robot 2 was killed before it handed anything in; its counters are in its folder: 0.5 s of CPU time at 10 W.
    meter = Meter("client", tmp_path / "state" / "agent-2")
    meter._cell(("", "fl/fl/learning/estimated: CPU time x 10 W", "joules")).add(5_000_000_000, 500_000_000, 10**9)
    handed_in = [drawn("agent-1", "learning", 3.0), drawn("agent-1", "idle", 0.5)]
    recorded(scenario, tmp_path / "run", {"agent-1": handed_in}, tmp_path / "state")
    lines = (tmp_path / "run" / "joules.jsonl").read_text().splitlines()
    rows: list[dict[str, Any]] = [json.loads(line) for line in lines]
    assert [(row["client"], row["activity"], row["joules"], row["how"]) for row in rows] == [
        ("agent-1", "learning", 3.0, "rapl"),
        ("agent-1", "idle", 0.5, "rapl"),
        ("agent-2", "learning", 5.0, "estimated: CPU time x 10 W"),
    ]
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["measured_j"] == {
        "robot": {
            "rapl": {"start": 0, "learning": 3.0, "communication": 0, "idle": 0.5, "total": 3.5},
            "estimated: CPU time x 10 W": {
                "start": 0, "learning": 5.0, "communication": 0, "idle": 0, "total": 5.0,
            },
        }
    }  # fmt: skip


def test_joules_in_anothers_name_are_refused(scenario: Scenario, tmp_path: Path) -> None:
    recorder = recorded(scenario, tmp_path / "run", {"agent-1": [drawn("agent-2", "idle", 9.0)]}, tmp_path / "state")
    assert recorder.refused == 1
    assert not (tmp_path / "run" / "joules.jsonl").exists()
    assert "measured_j" not in json.loads((tmp_path / "run" / "summary.json").read_text())
