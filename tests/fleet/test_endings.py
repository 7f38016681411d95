"""How a process ended is told with its cause, or with where to look for it."""

import signal
from pathlib import Path

import pytest

from jouleswarm.fleet.endings import ending, signal_of


@pytest.mark.parametrize(
    ("code", "sent"),
    [(-9, signal.SIGKILL), (143, signal.SIGTERM), (-7, signal.SIGBUS), (0, None), (2, None), (128, None), (255, None)],
)
def test_an_exit_code_tells_of_a_signal(code: int, sent: signal.Signals | None) -> None:
    assert signal_of(code) == sent


def test_the_last_words_of_a_process_are_told(tmp_path: Path) -> None:
    log = tmp_path / "agent-1.log"
    log.write_text("begun\nrobot 1: no such scenario\n")
    assert ending("agent-1", 2, log) == f"agent-1 ended with code 2: robot 1: no such scenario (all of it: {log})"


@pytest.mark.parametrize(
    ("code", "told"),
    [
        (-9, "agent-1 ended with code -9 (SIGKILL): sent from outside, or by the kernel when memory is short"),
        (-7, "agent-1 ended with code -7 (SIGBUS): a file that it had mapped could not be read or written"),
        (143, "agent-1 ended with code 143 (SIGTERM): sent from outside"),
        (1, "agent-1 ended with code 1: no cause told"),
    ],
)
def test_who_printed_nothing_has_a_cause_or_a_place_to_look(code: int, told: str, tmp_path: Path) -> None:
    log = tmp_path / "agent-1.log"
    log.touch()
    assert ending("agent-1", code, log).startswith(told)
    assert ending("agent-1", code, log).endswith(f"it printed nothing to {log}")


def test_who_could_not_say_that_the_disk_is_full_is_spoken_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jouleswarm.fleet.endings.is_full", lambda folder: folder == tmp_path)
    (log := tmp_path / "datacenter.log").write_text("waiting for round 2\n")
    told = ending("datacenter", 5, log)
    assert told.endswith(f"; no space left on {tmp_path}; make room, then go on from what is there")
    log.write_text("data center: no space left on state.0 (0.1 MB needed)\n")
    assert ending("datacenter", 5, log).count("no space left") == 1


def test_a_log_that_is_gone_is_told(tmp_path: Path) -> None:
    told = ending("agent-1", 5, tmp_path / "moved" / "agent-1.log")
    assert told.endswith("agent-1.log is gone; was the run directory moved or removed?")
