"""Starts the brokers that the benchmarks compare."""

from __future__ import annotations

import contextlib
import json
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from jouleswarm.common.bus.mqtt import MqttBus

_MOSQUITTO_CONFIG = """\
listener {port} 127.0.0.1
allow_anonymous true
set_tcp_nodelay true
max_inflight_messages 0
max_queued_messages 0
log_type error
"""


@dataclass(frozen=True)
class Running:
    """A broker that runs."""

    url: str
    pid: int


@contextlib.contextmanager
def embedded(*options: str) -> Iterator[Running]:
    """The broker of this repository."""
    command = [sys.executable, "-m", "jouleswarm.broker", "--port", "0", "--no-metrics", "--exit-with-stdin", *options]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        yield Running(json.loads(process.stdout.readline())["url"], process.pid)
        process.stdin.close()
        process.wait(timeout=10)


@contextlib.contextmanager
def mosquitto() -> Iterator[Running]:
    """Mosquitto without limits and without Nagle's delay."""
    program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    if program is None:
        sys.exit("this benchmark compares with Mosquitto: apt-get install mosquitto")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "mosquitto.conf")
        config.write_text(_MOSQUITTO_CONFIG.format(port=port), encoding="utf-8")
        process = subprocess.Popen([program, "-c", str(config)], stderr=subprocess.DEVNULL)
        url = f"mqtt://127.0.0.1:{port}"
        MqttBus.connect(url, "probe").close()
        yield Running(url, process.pid)
        process.terminate()
        process.wait(timeout=10)
