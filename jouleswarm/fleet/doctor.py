"""`jouleswarm doctor`: what this machine has, to be pasted into a bug report: no names of users and hosts in it."""

from __future__ import annotations

import getpass
import importlib.metadata
import os
import platform
import re
import resource
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from jouleswarm.common.bus.credentials import credentials_of
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.errors import BrokerUnreachableError
from jouleswarm.common.host import machine
from jouleswarm.common.meter.power import told as how_measured
from jouleswarm.common.scenario.measure import Measure
from jouleswarm.fleet.recorder import CLIENT

PORTS = {1883: "MQTT", 8883: "MQTT over TLS", 9883: "metrics"}
_PACKAGES = (
    *("torch", "numpy", "gymnasium", "amqtt", "paho-mqtt", "opencv-python-headless", "pydantic", "typer", "rich"),
    *("matplotlib", "pandas", "pyarrow", "tensorboard", "mlflow", "minigrid", "nvidia-ml-py"),
)
_ANSWER_S = 5.0
_GB = 1e9


def findings() -> dict[str, str]:
    """What -> how it is, in words, in order."""
    return {what: anonymous(told) for what, told in _found()}


def broker_finding(url: str, keys: Path | None) -> str:
    """How long a broker took to answer.

    Raises:
        ConfigurationError: the URL, or the broker has refused the client.
        BrokerUnreachableError: it does not answer; its address is not repeated.
    """
    begun = time.monotonic()
    credentials = credentials_of(keys, CLIENT)
    try:
        MqttBus.connect(url, CLIENT, credentials=credentials, connect_timeout_s=_ANSWER_S).close()
    except BrokerUnreachableError:
        raise BrokerUnreachableError(
            f"broker: no answer within {_ANSWER_S:g} s; see that it runs, and that --broker is its address"
        ) from None
    return f"answers, in {1e3 * (time.monotonic() - begun):.0f} ms"


def anonymous(text: str) -> str:
    """The same with ~ for the home folder, and without the user's and the host's name."""
    text = text.replace(str(Path.home()), "~") if len(str(Path.home())) > 1 else text
    for name, stands_for in ((_user(), "USER"), (socket.gethostname(), "HOST")):
        text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", stands_for, text) if name else text
    return text


def _found() -> Iterator[tuple[str, str]]:
    here = machine()
    yield "JouleSwarm", f"{importlib.metadata.version('jouleswarm')}, in {Path(__file__).parents[1]}"
    yield "Python", f"{platform.python_version()} ({platform.python_implementation()})"
    yield "packages", ", ".join(f"{name} {_version(name)}" for name in _PACKAGES)
    yield "system", str(here["system"])
    yield "processor", str(here["processor"])
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else here["cores"]
    yield "cores", f"{here['cores']}, {usable} of them for this process"
    yield "memory", _memory()
    yield "disk here", f"{shutil.disk_usage('.').free / _GB:.1f} GB free"
    yield "open files", f"{resource.getrlimit(resource.RLIMIT_NOFILE)[0]} a process"
    for port, what in PORTS.items():
        yield f"port {port}", f"{_port(port)} ({what})"
    yield "Docker", _asked("the daemon does not answer", "docker", "version", "--format", "{{.Server.Version}}")
    yield "Compose", _asked("not installed", "docker", "compose", "version")
    yield "joules", how_measured(Measure()).removeprefix("measured joules: ")
    yield "GPU's joules", _gpus()


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "-"


def _memory() -> str:
    page = os.sysconf("SC_PAGE_SIZE")
    whole, free = (page * os.sysconf(name) / _GB for name in ("SC_PHYS_PAGES", "SC_AVPHYS_PAGES"))
    return f"{whole:.1f} GB, {free:.1f} GB free"


def _port(port: int) -> str:
    with socket.socket() as tried:
        tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            tried.bind(("127.0.0.1", port))
        except OSError as error:
            return f"in use: {error.strerror}"
    return "free"


def _asked(else_: str, *command: str) -> str:
    if shutil.which(command[0]) is None:
        return "not installed"
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_ANSWER_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return else_
    lines = done.stdout.strip().splitlines()
    return lines[0] if lines and done.returncode == 0 else else_


def _gpus() -> str:
    try:
        import pynvml
    except ImportError:
        return "not looked for: pip install jouleswarm[measure]"
    try:
        pynvml.nvmlInit()
        handles = [pynvml.nvmlDeviceGetHandleByIndex(each) for each in range(pynvml.nvmlDeviceGetCount())]
        for each in handles:
            pynvml.nvmlDeviceGetTotalEnergyConsumption(each)
        return ", ".join(f"{pynvml.nvmlDeviceGetName(each)}: NVML" for each in handles) or "no GPU"
    except pynvml.NVMLError as error:
        return f"not measured: NVML: {error}"


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user that has no name
        return ""
