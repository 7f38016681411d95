"""Going on with a run: nobody else is at work on it, and all is as it was written, before anything starts."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.disk.state import State
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.counters import Counters
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet import deploy as module
from jouleswarm.fleet.deploy import resume_deployment, run_deployment
from jouleswarm.runs.directory import RunDirectory
from jouleswarm.runs.manifest import manifest


@pytest.fixture(autouse=True)
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Instead of a deployment: the runs that would have been started."""
    runs: list[str] = []
    monkeypatch.setattr(module, "_deploy", lambda scenario, run, *_: runs.append(run))
    return runs


def made_up() -> Scenario:
    world = {"rows": 3, "cols": 2}
    tasks = [{"id": 1, "map": "E . \n * . \n X ."}]
    return scenario_from({"name": "t", "methods": ["fl"], "world": world, "tasks": tasks}, "test")


@pytest.fixture
def interrupted(tmp_path: Path) -> Path:
    """A run of two robots that was killed after a round."""
    scenario = made_up()
    path = tmp_path / "run"
    directory = RunDirectory(path, state=path / "state" / "recorder")
    directory.manifest(manifest(scenario, "r", "mqtt://localhost:1883", embedded=True))
    directory.weights("fl-task1", b"model")
    for name in ("agent-1", "agent-2", "broker"):
        counters = Counters(path / "state" / name)
        counters.cell((name, "jouleswarm/r/fl/sl/1/1/weights", "out")).add(10, 20)
        if name != "broker":
            StateFile(path / "state" / name / "state", name).save(State(values={"round": 1}))
    for agent in (1, 2):
        directory.round(RoundRow(phase="fl", arm="fl", task=1, agent=agent, round=1, seconds=0.1))
    return path


def resume(path: Path) -> str:
    console = Console(file=io.StringIO(), width=1000)
    resume_deployment(path, console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_run_that_is_as_it_was_is_gone_on_with_and_let_go_of(interrupted: Path, started: list[str]) -> None:
    resume(interrupted)
    assert started == ["r"]
    assert not (interrupted / ".lock").exists()


def test_a_run_that_somebody_is_at_work_on_is_refused_with_their_name(interrupted: Path, started: list[str]) -> None:
    with Lock(interrupted, "jouleswarm run"), pytest.raises(ConfigurationError, match="is held by jouleswarm run, pro"):
        resume(interrupted)
    assert started == []


def test_children_who_outlive_their_launcher_for_long_are_named(
    interrupted: Path, started: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_WAIT_FOR_CHILDREN_S", 0.2)
    folder = interrupted / "state" / "agent-2"
    with Lock(folder, "robot 2"), pytest.raises(ConfigurationError, match=f"{folder} is held by robot 2, process"):
        resume(interrupted)
    assert started == []


def test_a_new_run_takes_no_directory_that_is_held(tmp_path: Path, interrupted: Path, started: list[str]) -> None:
    scenario = made_up()
    with Lock(tmp_path / "new", "jouleswarm run"), pytest.raises(ConfigurationError, match="is held by"):
        run_deployment(scenario, "new", tmp_path, Console(file=io.StringIO()))
    run_deployment(scenario, "new", tmp_path, Console(file=io.StringIO()))
    assert started == ["new"]


def altered(name: str) -> Callable[[Path], Path]:
    def alter(path: Path) -> Path:
        content = (path / name).read_bytes()
        (path / name).write_bytes(content[:40] + bytes([content[40] ^ 1]) + content[41:] if len(content) > 40 else b"?")
        return path / name

    return alter


def gone(name: str) -> Callable[[Path], Path]:
    def remove(path: Path) -> Path:
        (path / name).unlink()
        return path / name

    return remove


DAMAGES = [
    altered("manifest.json"),
    altered("weights/fl-task1.safetensors"),
    gone("weights/fl-task1.safetensors"),
    altered("state/agent-1/state.0"),
    gone("state/agent-2/state.1"),
    altered("state/agent-1/counters-0.bin"),
    altered("state/broker/counters-0.bin"),
    gone("state/broker/counters-0.bin"),
]


@pytest.mark.parametrize("number", range(len(DAMAGES)))
def test_what_is_not_as_it_was_written_is_refused_by_name_before_anything_starts(
    number: int, interrupted: Path, started: list[str]
) -> None:
    file = DAMAGES[number](interrupted)
    with pytest.raises(RunError, match=f"{file}: (not as it was written|gone|damaged)"):
        resume(interrupted)
    assert started == []
    assert not (interrupted / ".lock").exists()


@pytest.mark.parametrize("name", ["agent-2", "broker"])
def test_somebody_who_has_lost_all_that_they_had_is_named(name: str, interrupted: Path, started: list[str]) -> None:
    for file in (interrupted / "state" / name).iterdir():
        file.unlink()
    with pytest.raises(ConfigurationError, match=rf"state/{name}/\S+ is missing or empty"):
        resume(interrupted)
    assert started == []


def test_rows_of_a_stage_that_is_over_are_looked_through_too(interrupted: Path, started: list[str]) -> None:
    rows = interrupted / "state" / "datacenter" / "rounds.jsonl"
    rows.parent.mkdir()
    rows.write_bytes(b"\xff\xfe{}\n")
    with pytest.raises(RunError, match=f"{rows}, line 1: not as it was written"):
        resume(interrupted)
    assert started == []


def test_a_run_that_is_complete_is_told_so(interrupted: Path, started: list[str]) -> None:
    (interrupted / "state").rename(interrupted / "elsewhere")
    with pytest.raises(ConfigurationError, match=r"has no state/: it is complete, or was only recorded"):
        resume(interrupted)
    assert started == []
