"""What goes wrong while a run is under way: interrupts, deaths, brokers that are not there."""

import contextlib
import json
import os
import re
import signal
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.integration.conftest import DEADLINE_S, SMALL, wait_until

TOY = str(Path(__file__).parents[2] / "scenarios" / "toy.toml")
LONG = ("federation.target_reward=1000", "federation.max_rounds=2000")


def sets(overrides: tuple[str, ...]) -> list[str]:
    return [part for each in overrides for part in ("--set", each)]


def has_rows(path: Path, phase: str) -> Callable[[], bool]:
    rounds = path / "rounds.jsonl"
    return lambda: rounds.exists() and f'"phase":"{phase}"' in rounds.read_text()


def fork_server_of(run: Any) -> list[psutil.Process]:
    return [process for process in run.family if "forkserver" in " ".join(process.cmdline())]


def marked(mark: str) -> list[psutil.Process]:
    """Everything alive that was started with TEST_MARK=mark in its environment, whoever its parent is by now."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if process.environ().get("TEST_MARK") == mark and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


STAGES: dict[str, Callable[[Any, Path], bool]] = {
    "starting": lambda run, path: bool(fork_server_of(run)),  # which is loading torch
    "meta-learning": lambda run, path: has_rows(path, "maml")(),
    "federated": lambda run, path: has_rows(path, "fl")(),
}


@pytest.mark.parametrize("stage", STAGES)
def test_ctrl_c_ends_every_process_and_leaves_a_readable_run(
    stage: str, start: Any, eventually: Any, read_run: Any, tmp_path: Path
) -> None:
    more = ("meta.t0=2000",) if stage == "meta-learning" else ("meta.t0=2",)
    options = ["--out", str(tmp_path), "--run-id", "r", *sets((*LONG, *more))]
    run = start.jouleswarm("run", TOY, *options, TEST_MARK=str(tmp_path))
    eventually(lambda: STAGES[stage](run, tmp_path / "r"), stage)
    assert len(marked(str(tmp_path))) >= 3
    os.killpg(run.process.pid, signal.SIGINT)  # as a terminal does
    assert run.ends() == 130, run.printed
    eventually(lambda: not marked(str(tmp_path)), "the end of all")
    assert "Traceback" not in run.printed

    assert read_run(tmp_path / "r").summary["status"] == "interrupted"
    assert (tmp_path / "r" / "state").is_dir()  # what it is gone on with from
    report = start.jouleswarm("report", str(tmp_path / "r"))
    assert report.ends() == 0, report.printed
    assert "interrupted" in report.printed


def test_a_launcher_that_is_killed_takes_its_processes_along(start: Any, eventually: Any, tmp_path: Path) -> None:
    options = ["--out", str(tmp_path), "--run-id", "r", *sets((*LONG, "methods=['fl']", "bus.connect_timeout_s=1"))]
    run = start.jouleswarm("run", TOY, *options, TEST_MARK=str(tmp_path))
    eventually(has_rows(tmp_path / "r", "fl"), "the first round")
    run.process.kill()
    eventually(lambda: not marked(str(tmp_path)), "the end of all", within_s=20)


def test_a_process_that_is_killed_and_may_not_be_started_again_ends_the_run_with_its_name(
    start: Any, eventually: Any, read_run: Any, tmp_path: Path
) -> None:
    options = ["--out", str(tmp_path), "--run-id", "r", "--restarts", "0", *sets((*LONG, "methods=['fl']"))]
    run = start.jouleswarm("run", TOY, *options)
    eventually(has_rows(tmp_path / "r", "fl"), "the first round")
    family = run.family
    (fork_server,) = (
        process for process in family if "forkserver" in " ".join(process.cmdline()) and process.children()
    )
    robots = fork_server.children()
    assert len(robots) == 4
    robots[0].kill()
    assert run.ends() == 5
    assert "ended with code -9" in run.printed
    assert "jouleswarm run: agent-" in run.printed
    _, alive = psutil.wait_procs(family, timeout=DEADLINE_S)
    assert alive == []
    assert read_run(tmp_path / "r").summary["status"] == "failed"


def test_a_broker_that_dies_and_may_not_be_started_again_ends_the_run_and_says_so(
    start: Any, eventually: Any, tmp_path: Path
) -> None:
    run = start.jouleswarm(
        "run", TOY, "--out", str(tmp_path), "--run-id", "r", "--restarts", "0",
        *sets((*LONG, "methods=['fl']", "bus.connect_timeout_s=1")),
    )  # fmt: skip
    eventually(has_rows(tmp_path / "r", "fl"), "the first round")
    family = run.family
    (broker,) = (process for process in family if "jouleswarm.broker" in process.cmdline())
    broker.kill()
    assert run.ends() in (3, 5)
    assert "broker" in run.printed
    assert "Traceback" not in run.printed
    _, alive = psutil.wait_procs(family, timeout=DEADLINE_S)
    assert alive == []
    report = start.jouleswarm("report", str(tmp_path / "r"))
    assert report.ends() == 0, report.printed


def test_a_robot_that_ends_with_an_error_shows_it(start: Any, tmp_path: Path) -> None:
    # Weights or the loss overflow in the first gradient steps, whichever is noticed first.
    run = start.jouleswarm(
        "run", TOY, "--out", str(tmp_path), "--run-id", "r",
        *sets(("methods=['fl']", "learning.optimizer=sgd", "learning.lr=1000", "learning.grad_clip=1e9")),
    )  # fmt: skip
    assert run.ends() == 5
    assert "ended with code 4" in run.printed
    assert re.search("loss is not finite|has a weight of size", run.printed)


@pytest.fixture
def nowhere() -> str:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return f"mqtt://127.0.0.1:{sock.getsockname()[1]}"


@pytest.mark.parametrize(
    "command",
    [
        ("jouleswarm.agents", "--id", "1", "--scenario", TOY),
        ("jouleswarm.datacenter", "--scenario", TOY),
        ("jouleswarm", "run", TOY),
        ("jouleswarm", "record", TOY),
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_a_broker_that_is_not_there_is_said_with_exit_code_3(
    command: tuple[str, ...], nowhere: str, start: Any, tmp_path: Path
) -> None:
    out = ("--out", str(tmp_path)) if command[0] == "jouleswarm" else ()
    process = start.python(*command, "--broker", nowhere, *out, *sets(("bus.connect_timeout_s=1",)))
    assert process.ends() == 3, process.printed
    last = process.printed.splitlines()[-1]
    assert f"no MQTT broker at {nowhere} for 1 s" in last
    assert "Connection refused" in last


def test_a_run_directory_is_never_written_over(start: Any, tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "precious").write_text("mine")
    process = start.jouleswarm("run", TOY, "--out", str(tmp_path), "--run-id", "r")
    assert process.ends() == 2
    assert process.printed.splitlines() == [
        f"jouleswarm run: run directory {tmp_path / 'r'} is not empty; name another with --out or --run-id"
    ]
    assert [path.name for path in (tmp_path / "r").iterdir()] == ["precious"]


WRONG_ROBOTS = {
    "another task": (
        ("--id", "1", "--task", "2"),
        "--task 2: the scenario gives robot 1 task 1; robots of task 2: [3, 4]",
    ),
    "no such robot": (("--id", "9"), "robot 9 is not in the scenario, expected one of (1, 2, 3, 4)"),
    "bad URL": (("--id", "1", "--broker", "http://localhost"), "expected mqtt://"),
    "bad override": (("--id", "1", "--set", "bus.qos=2"), "bus.qos"),
}


@pytest.mark.parametrize("case", WRONG_ROBOTS)
def test_a_robot_started_wrongly_says_so_in_one_line_with_exit_code_2(case: str, start: Any) -> None:
    options, said = WRONG_ROBOTS[case]
    process = start.python("jouleswarm.agents", "--quiet", "--scenario", TOY, *options)
    assert process.ends() == 2
    (line,) = process.printed.splitlines()
    assert line.startswith(f"robot {options[1]}: ")
    assert said in line


def test_every_option_of_a_robot_is_taken_from_the_environment_too(start: Any, nowhere: str) -> None:
    process = start.python(
        "jouleswarm.agents", JOULESWARM_ID="1", JOULESWARM_TASK="1", JOULESWARM_SCENARIO=TOY, JOULESWARM_BROKER=nowhere,
        JOULESWARM_RUN="r", JOULESWARM_SET="bus.connect_timeout_s=0.5", JOULESWARM_VERBOSE="0",
    )  # fmt: skip
    assert process.ends() == 3
    assert f"no MQTT broker at {nowhere} for 0.5 s" in process.printed


def test_a_data_center_without_an_arm_to_serve_says_so(start: Any) -> None:
    process = start.python("jouleswarm.datacenter", "--quiet", "--scenario", TOY, *sets(("methods=['fl']",)))
    assert process.ends() == 2
    (line,) = process.printed.splitlines()
    assert "need no data center" in line


def test_a_scenario_file_that_is_edited_or_gone_changes_nothing_in_a_run(start: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(Path(TOY).read_text())
    options = ["--out", str(tmp_path), "--run-id", "r", "--no-figures", "--seed", "2"]
    more = sets((*SMALL, "methods=['fl']"))
    # --set and --seed take the place of the environment: for the processes of the run too.
    run = start.jouleswarm("run", str(file), *options, *more, JOULESWARM_SET="seed=3", JOULESWARM_TASK="2")
    wait_until((tmp_path / "r" / "manifest.json").exists, "the manifest")
    file.write_text("seed = 9")
    assert run.ends() == 0, run.printed
    assert json.loads((tmp_path / "r" / "manifest.json").read_text())["scenario"]["seed"] == 2
