"""Processes are started, watched, and none is left behind."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.counters import read_counters
from jouleswarm.common.wire import topics
from jouleswarm.fleet import launcher as launching
from jouleswarm.fleet.endings import signal_of
from jouleswarm.fleet.launcher import Launcher

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
    told = pytest.raises(ConfigurationError, match=r"broker ended with code 2: .*no-such")
    with Launcher(tmp_path / "logs") as launcher, told:
        launcher.start_broker(["--no-such-option"])


def test_a_broker_that_died_is_noticed(tmp_path: Path) -> None:
    with Launcher(tmp_path / "logs") as launcher:
        launcher.start_broker(["--no-metrics"])
        os.kill(launcher.pids["broker"], signal.SIGKILL)
        with pytest.raises(RunError, match="broker ended with code -9"):
            check_until_something_ended(launcher)


def test_a_process_that_ended_with_an_error_is_noticed_with_its_last_words(tmp_path: Path) -> None:
    with Launcher(tmp_path / "logs", restarts=5) as launcher:  # an exit code is no signal: not started again
        launcher.start("agent-9", "jouleswarm.agents", ["--id", "9", "--scenario", TOY])
        assert ended(launcher.pids["agent-9"])
        # The kernel forgets the process a moment before its exit code has come from the fork server.
        with pytest.raises(RunError, match=r"agent-9 ended with code 2: robot 9: robot 9 is not in the scenario"):
            check_until_something_ended(launcher)
    assert "robot 9 is not in the scenario" in (tmp_path / "logs" / "agent-9.log").read_text()


def kill(launcher: Launcher, name: str) -> int:
    os.kill(launcher.pids[name], signal.SIGKILL)
    return launcher.pids[name]


def check_until_another_runs(launcher: Launcher, name: str, before: int) -> None:
    deadline_s = time.monotonic() + DEADLINE_S
    while launcher.pids[name] == before:
        assert time.monotonic() < deadline_s
        launcher.check()
        time.sleep(0.01)


def test_a_broker_that_was_killed_comes_back_where_it_was_as_often_as_is_allowed(tmp_path: Path) -> None:
    told: list[str] = []
    with Launcher(tmp_path / "logs", restarts=2, told=told.append) as launcher:
        url = launcher.start_broker(["--state", str(tmp_path / "state")])["url"]
        bus = MqttBus.connect(url, "agent-1", connect_timeout_s=DEADLINE_S)
        for round_ in (1, 2):
            check_until_another_runs(launcher, "broker", kill(launcher, "broker"))
            bus.publish(topics.weights("r", "fl", 1, 1), b"12345")
            bus.flush()  # it is there again, at the same address
            assert read_counters(tmp_path / "state")["agent-1", topics.weights("r", "fl", 1, 1), "in"][0] >= round_
        bus.close()
        os.kill(launcher.pids["broker"], signal.SIGKILL)
        with pytest.raises(RunError, match="broker ended with code -9"):
            check_until_something_ended(launcher)
    assert told == ["broker was ended by SIGKILL; starting it again"] * 2


def test_who_waits_for_an_answer_of_a_broker_that_was_killed_starts_it_again_and_is_told_why_it_ended(
    tmp_path: Path,
) -> None:
    told: list[str] = []
    with Launcher(tmp_path / "logs", restarts=1, told=told.append) as launcher:
        url = launcher.start_broker(["--no-metrics"])["url"]
        bus = MqttBus.connect(url, "r", connect_timeout_s=DEADLINE_S, look_after_broker=launcher.check_broker)
        before = kill(launcher, "broker")
        bus.publish("a/b", b"1")
        bus.flush()  # nobody else looks after it
        assert launcher.pids["broker"] != before
        assert told == ["broker was ended by SIGKILL; starting it again"]
        kill(launcher, "broker")
        with pytest.raises(RunError, match="broker ended with code -9"):
            bus.receive(DEADLINE_S)
        bus.close()


def test_a_process_that_is_held_is_not_started_again_before_its_time(tmp_path: Path) -> None:
    with Launcher(tmp_path / "logs", restarts=1) as launcher:
        launcher.start_broker(["--no-metrics"])
        launcher.hold("broker", 3600)
        before = kill(launcher, "broker")
        assert launcher._broker is not None
        launcher._broker.wait(DEADLINE_S)
        launcher.check()
        assert launcher.pids["broker"] == before
        launcher.hold("broker", 0)
        check_until_another_runs(launcher, "broker", before)


def test_a_robot_that_was_killed_is_started_again_as_often_as_is_allowed(tmp_path: Path) -> None:
    told: list[str] = []
    options = ["--scenario", TOY, "--broker", "mqtt://127.0.0.1:1", "--set", "bus.connect_timeout_s=600"]
    with Launcher(tmp_path / "logs", restarts=2, told=told.append) as launcher:
        launcher.start("agent-1", "jouleswarm.agents", ["--id", "1", *options])
        for _ in range(2):
            check_until_another_runs(launcher, "agent-1", kill(launcher, "agent-1"))
        os.kill(launcher.pids["agent-1"], signal.SIGKILL)
        with pytest.raises(RunError, match="agent-1 ended with code -9"):
            check_until_something_ended(launcher)
    assert told == ["agent-1 was ended by SIGKILL; starting it again"] * 2


def test_a_robot_or_broker_that_is_told_to_end_from_outside_is_started_again(tmp_path: Path) -> None:
    told: list[str] = []
    with Launcher(tmp_path / "logs", restarts=1, told=told.append) as launcher:
        url = launcher.start_broker(["--no-metrics"])["url"]
        launcher.start("agent-1", "jouleswarm.agents", ["--id", "1", "--scenario", TOY, "--broker", url])
        bus = MqttBus.connect(url, "onlooker", connect_timeout_s=DEADLINE_S)
        bus.subscribe(topics.presence("toy", 1, 1))
        assert bus.receive(DEADLINE_S) is not None  # it has its way of ending by a signal by now
        for name in ("agent-1", "broker"):
            before = launcher.pids[name]
            os.kill(before, signal.SIGTERM)
            check_until_another_runs(launcher, name, before)
        assert told == [f"{name} was ended by SIGTERM; starting it again" for name in ("agent-1", "broker")]
        os.kill(launcher.pids["broker"], signal.SIGTERM)
        with pytest.raises(RunError, match=r"broker ended with code 0 \(SIGTERM\), after it was started again 1"):
            check_until_something_ended(launcher)


@pytest.mark.parametrize(
    ("name", "code", "number"),
    [
        ("agent-1", -9, signal.SIGKILL), ("agent-1", 143, signal.SIGTERM), ("agent-1", 130, signal.SIGINT),
        ("broker", 0, signal.SIGTERM), ("broker", -9, signal.SIGKILL), ("broker", 3, None), ("agent-1", 5, None),
        ("agent-1", 1, None), ("agent-1", 128, None), ("agent-1", 255, None),
    ],
)  # fmt: skip
def test_which_ends_are_by_a_signal(name: str, code: int, number: signal.Signals | None) -> None:
    assert signal_of(code, is_broker=name == "broker") == number


def test_processes_are_ended_when_the_launcher_is_left_by_an_error(tmp_path: Path) -> None:
    # A robot that waits for a broker that is not there.
    options = ["--scenario", TOY, "--broker", "mqtt://127.0.0.1:1", "--set", "bus.connect_timeout_s=600"]
    with contextlib.suppress(ZeroDivisionError), Launcher(tmp_path / "logs") as launcher:
        launcher.start("agent-1", "jouleswarm.agents", ["--id", "1", *options])
        launcher.start("datacenter", "jouleswarm.datacenter", options)
        launcher.start_broker(["--no-metrics"])
        pids = launcher.pids
        launcher.check()
        raise ZeroDivisionError
    assert set(pids) == {"agent-1", "datacenter", "broker"}
    assert all(ended(pid) for pid in pids.values())


WAITING = ["--id", "1", "--scenario", TOY, "--broker", "mqtt://127.0.0.1:1", "--set", "bus.connect_timeout_s=600"]


def server_of(launcher: Launcher) -> int:
    assert launcher._server is not None
    return launcher._server._process.pid


def test_a_fork_server_that_was_killed_is_started_again_with_its_processes(tmp_path: Path) -> None:
    told: list[str] = []
    with Launcher(tmp_path / "logs", restarts=1, told=told.append) as launcher:
        launcher.start("agent-1", "jouleswarm.agents", WAITING)
        before = launcher.pids["agent-1"]
        os.kill(server_of(launcher), signal.SIGKILL)
        check_until_another_runs(launcher, "agent-1", before)
        assert ended(before)
        os.kill(server_of(launcher), signal.SIGKILL)
        with pytest.raises(RunError, match=r"the fork server ended with code -9 \(SIGKILL\): sent from outside, or"):
            check_until_something_ended(launcher)
    assert told[0].startswith("the fork server ended with code -9 (SIGKILL)")
    assert told[1:] == ["agent-1 was ended by SIGKILL; starting it again"]


def test_a_process_that_ends_at_once_is_not_missed(tmp_path: Path) -> None:
    with Launcher(tmp_path / "logs") as launcher:
        launcher.start("agent-1", "jouleswarm.agents", ["--help"])
        child = launcher._children["agent-1"]
        child.join(DEADLINE_S)
        assert child.exitcode == 0


def test_a_broker_that_never_listens_is_not_waited_for_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(launching, "command_of", lambda _: [sys.executable, "-c", "input()"])
    monkeypatch.setattr(launching, "_BROKER_START_S", 0.05)
    with Launcher(tmp_path / "logs") as launcher, pytest.raises(RunError, match=r"did not listen within 0\.05 s; see "):
        launcher.start_broker()


LAUNCHES = """
import json, sys
from pathlib import Path
from jouleswarm.fleet.launcher import Launcher

with Launcher(Path(sys.argv[1])) as launcher:
    launcher.start_broker(["--no-metrics"])
    launcher.start("agent-1", "jouleswarm.agents", json.loads(sys.argv[2]))
    print(json.dumps([*launcher.pids.values(), launcher._server._process.pid]), flush=True)
    sys.stdin.read()
"""


def test_nothing_outlives_a_launcher_that_was_killed(tmp_path: Path) -> None:
    command = [sys.executable, "-c", LAUNCHES, str(tmp_path / "logs"), json.dumps(WAITING)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as launcher:
        assert launcher.stdout is not None
        pids = json.loads(launcher.stdout.readline())
        launcher.kill()
    assert len(pids) == 3
    assert all(ended(pid) for pid in pids)
