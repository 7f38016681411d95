"""The stack file of deploy/swarm.yml, as Docker reads it; secrets and waiting, which Kubernetes has too."""

from __future__ import annotations

import os
import re
import runpy
import socket
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import pytest
import yaml

from jouleswarm.common.scenario.reading import load_scenario

ROOT = Path(__file__).resolve().parents[1]
ROLES = {"broker": "broker", "recorder": "recorder", "datacenter": "datacenter", "agent": "robots"}


@pytest.fixture(scope="module")
def stack() -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load((ROOT / "deploy" / "swarm.yml").read_text())
    return document


def test_robots_are_those_of_the_scenario_and_take_their_id_from_their_slot(stack: dict[str, Any]) -> None:
    agent = stack["services"]["agent"]
    assert agent["environment"]["JOULESWARM_ID"] == "{{.Task.Slot}}"
    scenario, robots = agent["environment"]["JOULESWARM_SCENARIO"], agent["deploy"]["replicas"]
    assert scenario == "${JOULESWARM_SCENARIO:-quick}"
    assert robots == f"${{JOULESWARM_ROBOTS:-{len(load_scenario('quick').agents)}}}"


def test_every_role_has_its_secret_its_volumes_and_a_limit(stack: dict[str, Any]) -> None:
    assert set(stack["services"]) == set(ROLES)
    for role, service in stack["services"].items():
        (secret,) = service["secrets"]
        assert stack["secrets"][secret["source"]] == {"external": True, "name": f"jouleswarm-keys-{ROLES[role]}"}
        assert secret["mode"] == 0o400
        tmp, volume = service["volumes"]
        assert tmp == {"type": "tmpfs", "target": "/tmp"}
        assert volume.split(":")[0] in stack["volumes"]
        assert (service["read_only"], service["init"], service["cap_drop"]) == (True, True, ["ALL"])
        assert "memory" in service["deploy"]["resources"]["limits"]
    assert stack["networks"]["bus"]["internal"] is True


def test_a_process_is_root_nowhere_and_a_robots_cannot_read_the_keys_of_others(stack: dict[str, Any]) -> None:
    services = stack["services"]
    assert {services[role]["user"] for role in ("broker", "recorder", "datacenter")} == {"10001:10001"}
    line = services["agent"]["command"][-1]
    assert line.startswith("exec setpriv --reuid=10001 --regid=10001 --clear-groups --no-new-privs sh -c '")
    assert line.endswith("' </run/secrets/keys")
    assert "uid" not in services["agent"]["secrets"][0]  # root's
    # What was read from is closed before the process begins.
    assert line.index("tar -xzC") < line.index("exec </dev/null") < line.index("jouleswarm.agents")


def test_nobody_sends_before_the_recorder_listens_and_its_name_leads_somewhere_only_then(stack: dict[str, Any]) -> None:
    services = stack["services"]
    port = services["recorder"]["environment"]["JOULESWARM_METRICS_PORT"]
    for role in ("datacenter", "agent"):
        assert f"deploy/wait_for.py recorder {port} &&" in services[role]["command"][-1]
    ready = services["recorder"]["healthcheck"]["test"][-1]
    assert f"--ready-file {ready}" in services["recorder"]["command"][-1]


def test_a_secret_is_a_tar_file_of_the_folders_that_a_role_needs(keys: Path, tmp_path: Path) -> None:
    (docker := tmp_path / "docker").write_text(
        f'#!/bin/sh\ncp "$4" "{tmp_path}/$3.tar.gz"\n'
    )  # secret create NAME FILE
    docker.chmod(0o755)
    command = [ROOT / "deploy" / "secrets.sh", keys, "swarm"]
    path = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run(command, env=os.environ | path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    folders = {}
    for made in tmp_path.glob("*.tar.gz"):
        with tarfile.open(made) as packed:
            folders[made.name.removesuffix(".tar.gz")] = {member.name.split("/")[0] for member in packed}
    robots = {f"agent-{robot}" for robot in load_scenario("toy").agents}
    assert folders == {
        "jouleswarm-keys-broker": {"broker", "health"}, "jouleswarm-keys-recorder": {"recorder"},
        "jouleswarm-keys-datacenter": {"datacenter"}, "jouleswarm-keys-robots": robots,
    }  # fmt: skip


def test_a_folder_that_holds_no_keys_is_refused_in_a_line(tmp_path: Path) -> None:
    done = subprocess.run(
        [ROOT / "deploy" / "secrets.sh", tmp_path, "swarm"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert "KEYS made by 'jouleswarm keys init'" in done.stderr


def test_who_waits_for_a_port_comes_back_once_somebody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    script = runpy.run_path(str(ROOT / "deploy" / "wait_for.py"))
    with socket.socket() as reserved:
        reserved.bind(("127.0.0.1", 0))  # nobody listens yet: connections are refused
        pauses: list[float] = []

        def pause(seconds: float) -> None:
            pauses.append(seconds)
            if len(pauses) == 2:
                reserved.listen()

        monkeypatch.setattr("time.sleep", pause)
        script["wait_for"](*reserved.getsockname())
    assert pauses == [0.5, 0.5]


def test_the_image_has_what_the_files_call() -> None:
    copied = re.search(r"^COPY (.+) /app/deploy/$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert copied is not None
    assert copied[1].split() == ["deploy/broker_health.py", "deploy/wait_for.py"]


def test_runs_are_identical_but_for_times_and_a_bit_of_a_weight_is_told(tmp_path: Path) -> None:
    for name, seconds, weights in (("one", 1.5, b"\x01"), ("same", 2.5, b"\x01"), ("other", 1.5, b"\x00")):
        (models := tmp_path / name / "toy" / "weights").mkdir(parents=True)
        (models / "fl-task1.safetensors").write_bytes(weights)
        (models.parent / "rounds.jsonl").write_text(f'{{"round": 1, "reward": 50.0, "seconds": {seconds}}}\n')
        (models.parent / "summary.json").write_text("{}")
    for names, code, end in ((("one", "same"), 0, "identical"), (("one", "same", "other"), 1, "DIFFERENT")):
        done = subprocess.run(
            [sys.executable, ROOT / "deploy" / "identical.py", *names],
            cwd=tmp_path, capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (code, "")
        assert done.stdout.splitlines()[-1] == f"{names[-1]}: 1 rows, 1 models: {end}"
    alone = subprocess.run(
        [sys.executable, ROOT / "deploy" / "identical.py", "one"],
        cwd=tmp_path, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert (alone.returncode, alone.stdout) == (2, "")
