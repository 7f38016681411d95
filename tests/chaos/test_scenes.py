"""What is looked at between the two halves of a run that a fault has ended."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.chaos.plan import Fault
from jouleswarm.chaos.scenes import between, is_due_to
from jouleswarm.common.errors import ConfigurationError, RunError


@pytest.fixture
def lost() -> Fault:
    return Fault("state lost", "federated", target="agent-2")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "state" / "agent-2").mkdir(parents=True)
    (tmp_path / "state" / "agent-2" / "state.0").write_bytes(b"all")
    return tmp_path


def test_a_lost_state_is_away_when_the_run_is_gone_on_with_and_put_back_then(lost: Fault, run: Path) -> None:
    def resume() -> None:
        assert not (run / "state" / "agent-2").exists()
        raise ConfigurationError("run r: state/agent-2 is missing or empty")

    between(lost, KeyboardInterrupt(), run, resume)
    assert lost.note == "refused"
    assert (run / "state" / "agent-2" / "state.0").read_bytes() == b"all"
    assert [each.name for each in run.iterdir()] == ["state"]


def test_a_refusal_must_name_what_is_lost(lost: Fault, run: Path) -> None:
    def resume() -> None:
        raise ConfigurationError("run r: something is missing")

    between(lost, KeyboardInterrupt(), run, resume)
    assert lost.note == "NOT named: run r: something is missing"


def test_a_run_that_goes_on_without_a_state_is_found_out(lost: Fault, run: Path) -> None:
    between(lost, KeyboardInterrupt(), run, lambda: None)
    assert lost.note == "NOT refused"


def test_a_full_disk_must_be_what_the_run_says_it_ended_by(tmp_path: Path) -> None:
    told, untold = Fault("disk full", "federated"), Fault("disk full", "federated")
    between(
        told, RunError("agent-1 ended with code 5: no space left on state.0 (0.1 MB needed)"), tmp_path, lambda: None
    )
    between(untold, RunError("agent-1 ended with code 5: it printed nothing"), tmp_path, lambda: None)
    assert (told.note, untold.note) == ("no space left", "NOT told: agent-1 ended with code 5: it printed nothing")


def test_only_the_end_that_a_fault_was_to_bring_about_is_its_own() -> None:
    assert is_due_to(Fault("disk full", "federated"), RunError("no space left"))
    assert not is_due_to(Fault("disk full", "federated"), KeyboardInterrupt())
    assert is_due_to(Fault("run interrupted", "starting"), KeyboardInterrupt())
    assert not is_due_to(Fault("run interrupted", "starting"), RunError("agent-1 ended with code 4"))
