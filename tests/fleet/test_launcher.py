"""Processes are started, watched, and none is left behind."""

import contextlib
import os
import signal
import time
from pathlib import Path

import psutil
import pytest

from common.errors import RunError
from fleet.launcher import Launcher

ROOT = Path(__file__).parents[2]
TOY = str(ROOT / "scenarios" / "toy.toml")
DEADLINE_S = 60.0


@pytest.fixture(autouse=True)
def _in_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def ended(pid: int) -> bool:
    try:
        psutil.Process(pid).wait(DEADLINE_S)
    except psutil.NoSuchProcess:
        return True
    return not psutil.pid_exists(pid)


def check_until_something_ended(launcher: Launcher) -> None:
    deadline_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline_s:
        launcher.check()
        time.sleep(0.01)


def test_a_broker_that_listens_is_told_by_its_addresses_and_ended_with_the_launcher(tmp_path: Path) -> None:
    with Launcher(tmp_path / "logs") as launcher:
        ready = launcher.start_broker(["--no-metrics"])
        assert ready["url"].startswith("mqtt://127.0.0.1:")
        (pid,) = launcher.pids.values()
        assert psutil.pid_exists(pid)
        launcher.check()
    assert ended(pid)


def test_a_broker_that_cannot_start_is_an_error_with_what_it_printed(tmp_path: Path) -> None:
    with Launcher(tmp_path / "logs") as launcher, pytest.raises(RunError, match=r"broker ended with code 2: .*no-such"):
        launcher.start_broker(["--no-such-option"])


def test_a_broker_that_died_is_noticed(tmp_path: Path) -> None:
    with Launcher(tmp_path / "logs") as launcher:
        launcher.start_broker(["--no-metrics"])
        os.kill(launcher.pids["broker"], signal.SIGKILL)
        with pytest.raises(RunError, match="the broker ended with code -9"):
            check_until_something_ended(launcher)


def test_a_process_that_ended_with_an_error_is_noticed_with_its_last_words(tmp_path: Path) -> None:
    with Launcher(tmp_path / "logs") as launcher:
        launcher.start("agent-9", "agents", ["--id", "9", "--scenario", TOY])
        assert ended(launcher.pids["agent-9"])
        # The kernel forgets the process a moment before its exit code has come from the fork server.
        with pytest.raises(RunError, match=r"agent-9 ended with code 2: robot 9: robot 9 is not in the scenario"):
            check_until_something_ended(launcher)
    assert "robot 9 is not in the scenario" in (tmp_path / "logs" / "agent-9.log").read_text()


def test_processes_are_ended_when_the_launcher_is_left_by_an_error(tmp_path: Path) -> None:
    # A robot that waits for a broker that is not there.
    options = ["--scenario", TOY, "--broker", "mqtt://127.0.0.1:1", "--set", "bus.connect_timeout_s=600"]
    with contextlib.suppress(ZeroDivisionError), Launcher(tmp_path / "logs") as launcher:
        launcher.start("agent-1", "agents", ["--id", "1", *options])
        launcher.start("datacenter", "datacenter", options)
        launcher.start_broker(["--no-metrics"])
        pids = launcher.pids
        launcher.check()
        raise ZeroDivisionError
    assert set(pids) == {"agent-1", "datacenter", "broker"}
    assert all(ended(pid) for pid in pids.values())
