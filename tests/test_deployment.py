"""The deployment file, read as Docker Compose reads it; the health check, run against a real broker."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from jouleswarm.common.scenario.reading import load_scenario

ROOT = Path(__file__).resolve().parents[1]
ROBOTS = [f"agent-{number}" for number in range(1, 13)]
CLIENTS = ["recorder", "datacenter", *ROBOTS]
ROLES = ["keys", "broker", *CLIENTS]
WATCHERS = ["prometheus", "grafana"]


def read(name: str) -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load((ROOT / name).read_text())
    return document


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    return read("docker-compose.yml")


@pytest.fixture(scope="module")
def services(compose: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = compose["services"]
    return found


def test_the_deployment_is_keys_broker_recorder_data_center_and_twelve_robots(services: dict[str, Any]) -> None:
    assert sorted(role for role, service in services.items() if "profiles" not in service) == sorted(ROLES)
    assert {role: services[role]["profiles"] for role in WATCHERS} == {role: ["monitoring"] for role in WATCHERS}
    assert sorted(services) == sorted([*ROLES, *WATCHERS])


def test_the_robots_are_those_of_the_full_scenarios(services: dict[str, Any]) -> None:
    ids = tuple(services[robot]["environment"]["JOULESWARM_ID"] for robot in ROBOTS)
    assert ids == tuple(range(1, 13))
    for scenario in ("quick", "paper"):
        assert load_scenario(ROOT / "scenarios" / f"{scenario}.toml").agents == ids


@pytest.mark.parametrize("role", [*ROLES, *WATCHERS])
def test_a_container_has_no_privileges(services: dict[str, Any], role: str) -> None:
    service = services[role]
    assert service["init"] is True
    assert service["read_only"] is True
    assert service["tmpfs"] == ["/tmp"]
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert "privileged" not in service
    assert int(service["user"].split(":")[0]) > 0


@pytest.mark.parametrize("role", CLIENTS)
def test_all_processes_are_given_the_same_broker_and_scenario(services: dict[str, Any], role: str) -> None:
    environment = services[role]["environment"]
    assert environment["JOULESWARM_BROKER"] == "mqtts://broker:8883"
    assert environment["JOULESWARM_SCENARIO"] == "${JOULESWARM_SCENARIO:-scenarios/quick.toml}"
    assert environment["JOULESWARM_SET"] == "${JOULESWARM_SET:-}"
    assert {key: environment[key] for key in services["keys"]["environment"]} == services["keys"]["environment"]


def mounted_keys(service: dict[str, Any]) -> dict[str, str]:
    """Where a container sees which volume of keys; all are read-only."""
    mounts = [mount.split(":") for mount in service["volumes"] if mount.startswith("keys")]
    assert all(mode == "ro" for _, _, mode in mounts)
    return {target: volume for volume, target, _ in mounts}


@pytest.mark.parametrize("role", CLIENTS)
def test_a_container_sees_the_keys_of_its_own_client_only(services: dict[str, Any], role: str) -> None:
    assert mounted_keys(services[role]) == {f"/keys/{role}": f"keys-{role}"}
    assert services[role]["environment"]["JOULESWARM_KEYS"] == "/keys"


def test_the_broker_has_its_keys_and_those_of_its_health_check(services: dict[str, Any]) -> None:
    broker = services["broker"]
    assert mounted_keys(broker) == {"/keys/broker": "keys-broker", "/keys/health": "keys-health"}
    assert broker["environment"] == {
        "JOULESWARM_BROKER_HOST": "0.0.0.0", "JOULESWARM_KEYS": "/keys", "JOULESWARM_BROKER_STATE": "/state",
    }  # fmt: skip
    assert broker["depends_on"] == {"keys": {"condition": "service_healthy"}}


@pytest.mark.parametrize("role", [role for role in CLIENTS if role != "recorder"])
def test_a_process_remembers_its_rounds_when_its_container_is_killed(services: dict[str, Any], role: str) -> None:
    assert services[role]["environment"]["JOULESWARM_STATE"] == "/state"
    assert "/state" in services[role]["volumes"]


def test_keys_are_made_where_the_others_look_for_them(services: dict[str, Any], tmp_path: Path) -> None:
    keys = services["keys"]
    clients = ["broker", "health", *CLIENTS]
    handed = [f"keys-{client}:/handed/{client}" for client in clients]
    assert sorted(keys["volumes"]) == sorted(["./jouleswarm/scenarios:/app/scenarios:ro", "keys:/keys", *handed])
    for client in clients:
        (tmp_path / "handed" / client).mkdir(parents=True)
    _, _, line = keys["command"]
    line = line.replace("$$", "$").replace("/handed/", f"{tmp_path}/handed/")
    # The line itself, with other folders, and without the sleep.
    line = line.replace("/keys/", f"{tmp_path}/").replace("/tmp/made", f"{tmp_path}/made")
    line = line.replace("jouleswarm ", f"{sys.executable} -m jouleswarm ").replace("exec sleep infinity", "echo stays")
    settings = {"JOULESWARM_SCENARIO": "scenarios/quick.toml", "JOULESWARM_SET": ""}
    for said in ("certificates for 365 days", "is there already and serves"):
        done = subprocess.run(
            ["sh", "-c", line], cwd=ROOT, env=os.environ | settings, capture_output=True, text=True, timeout=60
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert said in done.stdout
        assert done.stdout.endswith("stays\n")
        assert keys["healthcheck"]["test"] == ["CMD", "test", "-f", "/tmp/made"]
        assert (tmp_path / "made").exists()
    folders = {path.name for path in (tmp_path / "swarm").iterdir() if path.is_dir()}
    assert folders == set(clients)
    assert (tmp_path / "handed" / "agent-3" / "password").read_text() == (
        tmp_path / "swarm" / "agent-3" / "password"
    ).read_text()
    assert not list((tmp_path / "handed").rglob("ca.key"))


@pytest.mark.parametrize("role", ["datacenter", *ROBOTS])
def test_nobody_sends_before_the_recorder_listens(services: dict[str, Any], role: str) -> None:
    assert services[role]["depends_on"] == {"recorder": {"condition": "service_healthy"}}
    assert services["recorder"]["depends_on"] == {"broker": {"condition": "service_healthy"}}
    assert services["recorder"]["healthcheck"]["test"][-1] in services["recorder"]["command"][-1]


@pytest.mark.parametrize("role", ["datacenter", *ROBOTS])
def test_a_process_that_is_done_stays_and_one_that_fails_ends_its_container(
    services: dict[str, Any], role: str, tmp_path: Path
) -> None:
    shell, option, line = services[role]["command"]
    assert (shell, option) == ("sh", "-c")
    # The line itself, with stand-ins for the process and for the sleep.
    line = line.replace("/tmp/done", str(tmp_path / "done"))
    for name, code in (("python", "exit ${CODE}"), ("sleep", "echo stays")):
        (tmp_path / name).write_text(f"#!/bin/sh\n{code}\n")
        (tmp_path / name).chmod(0o755)

    def run(code: int) -> tuple[int, str]:
        environment = {"PATH": f"{tmp_path}:/usr/bin:/bin", "CODE": str(code)}
        done = subprocess.run([shell, option, line], env=environment, capture_output=True, text=True, timeout=30)
        return done.returncode, done.stdout

    assert run(5) == (5, "")
    assert not (tmp_path / "done").exists()
    assert run(0) == (0, "stays\n")
    assert (tmp_path / "done").exists()


@pytest.mark.parametrize("role", ["datacenter", *ROBOTS])
def test_a_process_is_healthy_while_it_is_connected_to_the_broker_or_done(
    services: dict[str, Any], role: str, tmp_path: Path
) -> None:
    kind, line = services[role]["healthcheck"]["test"]
    assert (kind, 0x22B3) == ("CMD-SHELL", 8883)
    assert services[role]["environment"]["JOULESWARM_BROKER"].endswith(":8883")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port: int = listener.getsockname()[1]
        line = line.replace(":22B3", f":{port:04X}").replace("/tmp/done", str(tmp_path / "done"))

        def healthy() -> bool:
            return subprocess.run(["sh", "-c", line], timeout=10, capture_output=True).returncode == 0

        assert not healthy()  # it only listens
        with socket.create_connection(("127.0.0.1", port)):
            assert healthy()
    assert not healthy()
    (tmp_path / "done").touch()
    assert healthy()


@pytest.mark.parametrize("role", ROLES)
def test_every_container_has_a_limit_of_memory_and_of_processes(services: dict[str, Any], role: str) -> None:
    kind = {"keys": "KEYS", "broker": "BROKER", "recorder": "RECORDER", "datacenter": "DATACENTER"}.get(role, "ROBOT")
    limit = services[role]["mem_limit"]
    assert re.fullmatch(rf"\$\{{JOULESWARM_MEMORY_{kind}:-\d+[mg]}}", limit)
    assert services[role]["memswap_limit"] == limit  # no swap beyond it
    assert services[role]["pids_limit"] <= 256


def test_only_counters_and_who_shows_them_are_published_and_to_this_machine_alone(compose: dict[str, Any]) -> None:
    services, networks = compose["services"], compose["networks"]
    published = {role: service["ports"] for role, service in services.items() if "ports" in service}
    assert published == {
        "broker": ["127.0.0.1:${JOULESWARM_METRICS_PORT:-9883}:9883"],
        "prometheus": ["127.0.0.1:9090:9090"],
        "grafana": ["127.0.0.1:3000:3000"],
    }
    assert (networks["bus"]["internal"], networks["monitoring"]["internal"]) == (True, True)
    others = {"recorder": ["bus", "monitoring"]} | {role: ["monitoring", "metrics"] for role in WATCHERS}
    for role in set(services) - {"broker"}:
        assert services[role]["networks"] == others.get(role, ["bus"])


def test_prometheus_scrapes_the_ports_that_broker_and_recorder_serve_on(services: dict[str, Any]) -> None:
    (job,) = read("deploy/prometheus/prometheus.yml")["scrape_configs"]
    port = services["recorder"]["environment"]["JOULESWARM_METRICS_PORT"]
    assert job["static_configs"] == [{"targets": ["broker:9883", f"recorder:{port}"]}]
    assert services["recorder"]["environment"]["JOULESWARM_METRICS_HOST"] == "0.0.0.0"
    assert set(services["prometheus"]["networks"]) & set(services["recorder"]["networks"]) == {"monitoring"}


def test_grafana_finds_its_source_and_its_dashboards_where_they_are_mounted(services: dict[str, Any]) -> None:
    folder = "deploy/grafana/provisioning"
    (source,) = read(f"{folder}/datasources/prometheus.yml")["datasources"]
    (provider,) = read(f"{folder}/dashboards/jouleswarm.yml")["providers"]
    mounts = dict(volume.split(":")[:2] for volume in services["grafana"]["volumes"])
    assert source["url"] == "http://prometheus:9090"
    assert mounts["./deploy/grafana/dashboards"] == provider["options"]["path"]
    assert mounts[f"./{folder}"] == "/etc/grafana/provisioning"
    dashboard = json.loads((ROOT / "deploy/grafana/dashboards/jouleswarm.json").read_text())
    sources = {each["datasource"]["uid"] for panel in dashboard["panels"] for each in (panel, *panel["targets"])}
    assert sources == {source["uid"]}


def test_results_are_kept_in_a_volume(compose: dict[str, Any]) -> None:
    assert "runs:/runs" in compose["services"]["recorder"]["volumes"]
    assert "runs" in compose["volumes"]
    assert '--out "/runs/' in compose["services"]["recorder"]["command"][-1]


def test_the_toy_deployment_starts_the_toy_scenarios_robots_only() -> None:
    services = read("deploy/toy.compose.yml")["services"]
    started = [role for role, service in services.items() if "profiles" not in service]
    robots = load_scenario(ROOT / "scenarios/toy.toml").agents
    assert sorted(started) == sorted(["keys", "recorder", "datacenter", *(f"agent-{robot}" for robot in robots)])
    assert sorted(services) == sorted(role for role in ROLES if role != "broker")
    for role in started:
        assert services[role]["environment"] == {"JOULESWARM_SCENARIO": "scenarios/toy.toml"}


def test_the_toy_deployment_has_no_volumes_of_robots_that_do_not_exist(services: dict[str, Any]) -> None:
    toy = read("deploy/toy.compose.yml")["services"]
    left_out = {mount["target"]: mount["type"] for mount in toy["keys"]["volumes"]}
    assert set(left_out.values()) == {"tmpfs"}
    # Compose merges volumes by where a container sees them.
    made = [mount.split(":") for mount in services["keys"]["volumes"]]
    robots = {target for name, target, *_ in made if name.startswith("keys-agent-") and target not in left_out}
    assert robots == {f"/handed/agent-{robot}" for robot in load_scenario(ROOT / "scenarios/toy.toml").agents}


def test_the_image_runs_as_the_compose_user(services: dict[str, Any]) -> None:
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    assert f"USER {services['broker']['user']}" in lines


def test_image_and_makefile_install_the_same_pytorch() -> None:
    dockerfile, makefile = (ROOT / "Dockerfile").read_text(), (ROOT / "Makefile").read_text()
    pinned = next(line.split("=", 1)[1] for line in dockerfile.splitlines() if line.startswith("ARG TORCH="))
    assert f"TORCH       ?= {pinned}\n" in makefile


@pytest.fixture
def answering() -> Iterator[Any]:
    """Starts a server that answers one connection's first packet with given bytes; yields it, it returns the port."""
    listeners = []

    def start(answer: bytes) -> int:
        listener = socket.create_server(("127.0.0.1", 0))
        listeners.append(listener)

        def serve() -> None:
            with listener.accept()[0] as connection:
                connection.recv(64)
                connection.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        port: int = listener.getsockname()[1]
        return port

    yield start
    for listener in listeners:
        listener.close()


def health(port: int, keys: Path | None = None) -> tuple[int, str]:
    folder = None if keys is None else str(keys)
    code = f"from broker_health import check; import sys; sys.exit(check('127.0.0.1', {port}, {folder!r}))"
    done = subprocess.run(
        [sys.executable, "-S", "-c", code], cwd=ROOT / "deploy", capture_output=True, text=True, timeout=30
    )
    return done.returncode, done.stderr.strip()


@contextlib.contextmanager
def broker_process(*options: str) -> Iterator[int]:
    """Port of a real broker process."""
    command = [sys.executable, "-m", "jouleswarm.broker", "--port", "0", "--no-metrics", "--exit-with-stdin", *options]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as broker:
        assert broker.stdin is not None
        assert broker.stdout is not None
        yield int(json.loads(broker.stdout.readline())["url"].rsplit(":", 1)[1])
        broker.stdin.close()


@pytest.fixture
def broker_port() -> Iterator[int]:
    """Port of a broker without keys."""
    with broker_process() as port:
        yield port


def test_a_broker_with_keys_is_healthy_for_the_client_of_the_health_check(keys: Path, tmp_path: Path) -> None:
    with broker_process("--keys", str(keys)) as port:
        assert health(port, keys) == (0, "")
        shutil.copytree(keys / "health", tmp_path / "health")
        (tmp_path / "health" / "password").write_text("wrong\n")
        assert health(port, tmp_path) == (1, "CONNECT was answered by 20 02 00 04, expected 20 02 00 00")
        assert health(port)[0] == 1  # without TLS


def test_a_broker_that_accepts_a_client_is_healthy(broker_port: int) -> None:
    assert health(broker_port) == (0, "")


def test_a_refused_connection_is_not_healthy(answering: Any) -> None:
    # CONNACK with return code 5, not authorised (MQTT 3.1.1, table 3.1).
    expected = "CONNECT was answered by 20 02 00 05, expected 20 02 00 00"
    assert health(answering(b"\x20\x02\x00\x05")) == (1, expected)


def test_a_port_nobody_listens_on_is_not_healthy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    code, message = health(port)
    assert code == 1
    assert message.startswith(f"no broker at 127.0.0.1:{port}: ")


def test_the_recorder_says_when_it_listens_and_a_stop_leaves_a_readable_run(broker_port: int, tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    command = [sys.executable, "-m", "jouleswarm", "record", "--ready-file", str(ready), "--out", str(tmp_path)]
    settings = {"JOULESWARM_SCENARIO": "scenarios/toy.toml", "JOULESWARM_BROKER": f"mqtt://127.0.0.1:{broker_port}"}
    with subprocess.Popen(command, cwd=ROOT, env=os.environ | settings, stdout=subprocess.DEVNULL) as recorder:
        deadline_s = time.monotonic() + 60
        while not ready.exists():
            assert time.monotonic() < deadline_s
            with contextlib.suppress(subprocess.TimeoutExpired):
                pytest.fail(f"the recorder ended with code {recorder.wait(0.05)}")
        recorder.terminate()
        assert recorder.wait(30) == 130
    assert json.loads((tmp_path / "toy" / "summary.json").read_text())["status"] == "interrupted"
