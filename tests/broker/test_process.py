"""The broker as a process: options, readiness, its end."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.meter.counters import Counters

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", "jouleswarm.broker"]


def run(*options: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *options], cwd=ROOT, env=os.environ | environment, capture_output=True, text=True, timeout=30
    )


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_signal_ends_it_cleanly_with_clients_connected(raw, how, start_broker):
    process = subprocess.Popen(
        [*COMMAND, "--port", "0", "--no-metrics"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    line = process.stdout.readline()
    assert line.startswith("Broker at mqtt://127.0.0.1:")
    port = int(line.split(".0.1:")[1].split(".")[0])
    with socket.create_connection(("127.0.0.1", port)) as client:
        client.sendall(b"\x10\x0d\x00\x04MQTT\x04\x02\x00\x00\x00\x01x")
        assert client.recv(4) == b"\x20\x02\x00\x00"
        process.send_signal(how)
        _, errors = process.communicate(timeout=10)
        assert (process.returncode, errors) == (0, "")


def test_launched_broker_ignores_ctrl_c_and_ends_with_its_stdin(start_broker, raw):
    broker = start_broker()
    broker.process.send_signal(signal.SIGINT)
    client = raw(broker)
    client.connect("c")
    client.ping()
    broker.process.stdin.close()
    assert broker.process.wait(timeout=10) == 0


def test_launched_broker_ends_on_sigterm_too(start_broker):
    broker = start_broker()
    broker.process.send_signal(signal.SIGTERM)
    assert broker.process.wait(timeout=10) == 0


@pytest.mark.parametrize("option", ["--port", "--metrics-port"])
def test_port_in_use_is_one_clear_line_and_exit_code_2(option):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        result = run("--port", "0", "--metrics-port", "0", option, port)
    assert result.returncode == 2
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert f"port {port}" in line
    assert "in use" in line
    assert option in line


def test_a_state_folder_that_another_process_holds_is_one_clear_line_and_exit_code_2(tmp_path):
    with Lock(tmp_path, "broker"):
        ended = run("--port", "0", "--no-metrics", "--state", str(tmp_path))
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert f"broker: {tmp_path} is held by broker, process {os.getpid()} on " in line


def test_counters_that_are_not_as_they_were_written_are_one_clear_line_and_exit_code_5(tmp_path):
    Counters(tmp_path).cell(("agent-1", "topic", "in")).add(1, 2)
    (tmp_path / "counters-0.bin").write_bytes(b"")
    ended = run("--port", "0", "--no-metrics", "--state", str(tmp_path))
    assert ended.returncode == 5
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f"broker: {tmp_path}/counters-0.bin: not as it was written")


def test_address_that_is_not_ours_is_one_clear_line_and_exit_code_2():
    result = run("--host", "192.0.2.1", "--port", "0", "--no-metrics")
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert "192.0.2.1" in line


@pytest.mark.parametrize(
    "options", [("--port", "70000"), ("--memory-mb", "0"), ("--log-level", "LOUD"), ("--nonsense",)]
)
def test_bad_option_is_exit_code_2(options):
    result = run(*options)
    assert result.returncode == 2
    assert options[0] in result.stderr


def test_every_option_has_an_environment_variable():
    result = run("--port", "0", JOULESWARM_BROKER_METRICS_PORT="70000")
    assert result.returncode == 2
    assert "JOULESWARM_BROKER_METRICS_PORT" in result.stderr
    shown = run("--help", COLUMNS="200").stdout
    for name in ("HOST", "PORT", "METRICS_PORT", "MAX_MESSAGE_MB", "MEMORY_MB", "MAX_CONNECTIONS", "LOG_LEVEL"):
        assert f"JOULESWARM_BROKER_{name}" in shown


def printed_by(*options: str) -> str:
    """What a broker that listens has printed to stderr."""
    command = [*COMMAND, "--port", "0", "--no-metrics", "--exit-with-stdin", *options]
    process = subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline().startswith("{")
    return process.communicate(timeout=20)[1]


def test_a_broker_that_others_can_reach_without_users_says_so_in_one_line():
    (line,) = printed_by("--host", "0.0.0.0").splitlines()
    assert "on 0.0.0.0 without users: whoever reaches it may publish and read everything" in line
    assert "jouleswarm keys init" in line


def test_a_broker_with_users_but_without_tls_says_that_passwords_go_unencrypted(keys):
    files = ("--users", str(keys / "broker" / "users"), "--rights", str(keys / "broker" / "rights"))
    (line,) = printed_by("--host", "0.0.0.0", *files).splitlines()
    assert "without TLS: passwords and messages go unencrypted" in line


def test_a_broker_with_keys_or_on_this_machine_alone_says_nothing(keys):
    assert printed_by("--host", "0.0.0.0", "--keys", str(keys)) == ""
    assert printed_by("--host", "127.0.0.2") == ""


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--users", "{keys}/users"), "expected both"),
        (("--tls-cert", "{keys}/server.crt"), "expected --tls-cert and --tls-key"),
        (("--tls-client-ca", "{keys}/ca.crt"), "expected --tls-cert and --tls-key"),
        (("--tls-cert", "{keys}/server.crt", "--tls-key", "{keys}/rights"), "expected PEM files"),
        (("--tls-cert", "{keys}/missing", "--tls-key", "{keys}/server.key"), "No such file"),
        (("--users", "{keys}/rights", "--rights", "{keys}/rights"), "rights, line 3, user "),
        (("--users", "{keys}/users", "--rights", "{keys}/users"), "users, line 1: got "),
        (("--keys", "{keys}/nowhere"), "nowhere/broker"),
    ],
)
def test_access_options_that_cannot_be_used_are_one_clear_line_and_exit_code_2(keys, options, told):
    filled = [each.format(keys=keys / "broker") for each in options]
    result = run("--port", "0", "--no-metrics", *filled)
    assert (result.returncode, result.stdout) == (2, "")
    (line,) = result.stderr.splitlines()
    assert told in line


BROKEN = """
import asyncio, sys
import jouleswarm.broker.core, jouleswarm.broker.server

async def fails(self):
    raise KeyError("a fault")

async def hangs(self):
    await asyncio.Event().wait()

{fault}
jouleswarm.broker.server.LEAVE_S = 0.5
sys.argv = ["broker", "--port", "0", "--no-metrics", "--exit-with-stdin"]
from jouleswarm.broker.__main__ import app
app()
"""


def broken(fault: str, *, closing_stdin: bool) -> tuple[int, list[str]]:
    """Exit code and stderr of a broker with a fault."""
    process = subprocess.Popen(
        [sys.executable, "-c", BROKEN.format(fault=fault)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline().startswith("{")
    if closing_stdin:
        process.stdin.close()
    code = process.wait(timeout=20)
    return code, process.stderr.read().splitlines()


@pytest.mark.parametrize(
    "fault",
    [
        "jouleswarm.broker.server.SnapshotPublisher.run = fails",
        "jouleswarm.broker.server.watch = fails",
        "jouleswarm.broker.messages.Broker._session_monitor = fails",
    ],
)
def test_a_part_that_fails_ends_the_broker_with_one_last_line_that_says_so(fault):
    code, lines = broken(fault, closing_stdin=False)
    assert code == 5
    assert "broker: a part of the broker has failed (KeyError: 'a fault'), so it ends" in lines[-1]
    assert any("Traceback" in line for line in lines)


def test_leaving_has_an_end_of_its_own():
    code, lines = broken("jouleswarm.broker.messages.Broker.shutdown = hangs", closing_stdin=True)
    assert code == 5
    assert "did not leave within 0.5 s" in lines[-1]
