"""Who goes on with a run, or reads its bill, is told on what it was computed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.host import arithmetic
from jouleswarm.fleet import deploy as module
from jouleswarm.fleet.deploy import Options, resume_deployment
from jouleswarm.report.notes import notes
from jouleswarm.runs.directory import MANIFEST, ROUNDS, STATE
from jouleswarm.runs.run import load_run

HERE, THERE = "AVX2, one", "DEFAULT, one"


def noted(**computed_on: list[str]) -> dict[str, Any]:
    return {"cores": 2, "computed_on": {name.replace("_", "-"): held for name, held in computed_on.items()}}


@pytest.fixture
def begun(write_run: Callable[..., Path]) -> Path:
    """An interrupted run that was begun here."""
    path = write_run()
    (path / STATE).mkdir()
    (path / ROUNDS).unlink()  # nobody has told a row: nothing must be in the state
    change(path, host=noted(datacenter=[f"CUDA, {HERE}"], agent_1=[HERE], agent_2=[HERE]))
    return path


def change(path: Path, **fields: Any) -> None:
    manifest = json.loads((path / MANIFEST).read_text())
    (path / MANIFEST).write_text(json.dumps(manifest | fields))


def files(path: Path) -> dict[str, bytes]:
    return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


def test_a_run_is_not_gone_on_with_on_another_processor(begun: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_arithmetic_here", lambda: THERE)
    before = files(begun)
    with pytest.raises(ConfigurationError, match=f"begun on {HERE}; this is {THERE}: .*--other-processor") as caught:
        resume_deployment(begun, Console(quiet=True))
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)
    assert files(begun) == before


@pytest.mark.parametrize(("here", "allowed"), [(HERE, False), (THERE, True)])
def test_it_is_gone_on_with_on_the_same_one_or_if_told_to(
    begun: Path, monkeypatch: pytest.MonkeyPatch, here: str, allowed: bool
) -> None:
    deployed: list[str] = []
    monkeypatch.setattr(module, "_arithmetic_here", lambda: here)
    monkeypatch.setattr(module, "_deploy", lambda scenario, run, *rest: deployed.append(run))
    with Console(quiet=True) as console, console.capture():
        resume_deployment(begun, console, Options(other_processor=allowed))
    assert len(deployed) == 1


def test_a_process_of_its_own_says_what_is_computed_on_here() -> None:
    assert module._arithmetic_here() == arithmetic()


def test_a_report_says_what_it_was_computed_on(write_run: Callable[..., Path]) -> None:
    path = write_run()

    def told() -> list[str]:
        run = load_run(path)
        return [line for line in notes(run, run.scenario.energy) if line.startswith("Computed on")]

    assert told() == []  # not noted
    change(path, host=noted(agent_1=["one"], agent_2=["one"]))
    assert told() == ["Computed on one; elsewhere weights may differ in their bits."]
    change(path, host=noted(agent_1=["one"], agent_2=["one", "other"]))
    assert told() == [
        "Computed on different processors (agent-1, agent-2: one; agent-2: other): on one of them alone weights may "
        "be others."
    ]
