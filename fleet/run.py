"""A whole run from the operator's seat: start the processes (or not), record, report."""

from __future__ import annotations

import contextlib
import datetime
import importlib.metadata
import os
import platform
import secrets
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from common import topics
from common.errors import JouleSwarmError
from common.keys import Credentials, credentials_of
from common.mqtt import MqttBus, parse_url
from common.runlog import RunDirectory
from common.scenario import Scenario
from fleet.launcher import Launcher
from fleet.recorder import CLIENT, Recorder
from fleet.summary import SCHEMA
from fleet.view import View

_PACKAGES = ("amqtt", "gymnasium", "numpy", "opencv-python-headless", "paho-mqtt", "safetensors", "torch")
_PUMP_S = 0.2


def new_run_id(scenario: Scenario) -> str:
    """A name no other run has."""
    now = datetime.datetime.now(datetime.UTC).strftime("%Y%m%d-%H%M%S")
    return f"{scenario.name}-{now}-{secrets.token_hex(2)}"


def run_deployment(
    scenario: Scenario,
    scenario_options: list[str],
    run: str,
    out: Path,
    broker: str | None,
    console: Console,
    keys: Path | None = None,
) -> Path:
    """Run a scenario in processes of its own on this machine; returns the run directory.

    `scenario_options` are the command-line options that make every process load this same scenario. With
    `broker` the processes use that one; else an embedded broker is started. With a folder of `keys` all take
    their user, password and certificates from it.
    """
    if broker is not None:
        parse_url(broker)  # before anything is written
    credentials = credentials_of(keys, CLIENT)
    for agent in scenario.agents:
        credentials_of(keys, f"agent-{agent}")
    keys_options = [] if keys is None else ["--keys", str(keys.resolve())]
    directory = RunDirectory(out / topics.run_name(run))
    with ExitStack() as stack:
        launcher = stack.enter_context(Launcher(directory.path / "logs"))
        url = broker or _embedded_broker(launcher, console, keys_options)
        recording = _recording(scenario, url, run, directory, console, credentials, embedded=broker is None)
        recorder = stack.enter_context(recording)
        common = ["--broker", url, *keys_options, "--run", run, *scenario_options]
        if scenario.needs_datacenter:
            state = str(directory.path / "checkpoint")
            launcher.start("datacenter", "datacenter", [*common, "--state", state])
        for agent in scenario.agents:
            launcher.start(f"agent-{agent}", "agents", ["--id", str(agent), *common])
        _watch(scenario, recorder, console, launcher)
    return directory.path


def record_deployment(
    scenario: Scenario,
    run: str,
    out: Path,
    broker: str,
    console: Console,
    ready_file: Path | None = None,
    keys: Path | None = None,
) -> Path:
    """Record a run whose processes others start; returns the run directory.

    `ready_file` is written once the recorder listens: from then on the processes may be started.
    """
    parse_url(broker)  # before anything is written
    credentials = credentials_of(keys, CLIENT)
    directory = RunDirectory(out / topics.run_name(run))
    with _recording(scenario, broker, run, directory, console, credentials, embedded=False) as recorder:
        if ready_file is not None:
            ready_file.touch()
        _watch(scenario, recorder, console, None)
    return directory.path


def manifest(scenario: Scenario, run: str, url: str, *, embedded: bool) -> dict[str, Any]:
    """What `manifest.json` holds."""
    return {
        "schema": SCHEMA,
        "run": run,
        "scenario": scenario.model_dump(mode="json"),
        "seed": scenario.seed,
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in ("jouleswarm", *_PACKAGES)},
        },
        "host": {"system": platform.platform(), "machine": platform.machine(), "cores": os.cpu_count()},
        "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "broker": {"embedded": embedded, "url": str(parse_url(url))},  # without user and password
    }


def _embedded_broker(launcher: Launcher, console: Console, options: list[str]) -> str:
    ready = launcher.start_broker(options)
    console.print(f"broker {ready['url']}, metrics {ready['metrics']}", highlight=False)
    return ready["url"]


@contextlib.contextmanager
def _recording(
    scenario: Scenario,
    url: str,
    run: str,
    directory: RunDirectory,
    console: Console,
    credentials: Credentials | None,
    *,
    embedded: bool,
) -> Iterator[Recorder]:
    """A recorder that writes its summary however the run ends."""
    directory.manifest(manifest(scenario, run, url, embedded=embedded))
    bus = MqttBus.connect(
        url,
        CLIENT,
        credentials=credentials,
        keepalive_s=scenario.bus.keepalive_s,
        connect_timeout_s=scenario.bus.connect_timeout_s,
    )
    recorder = Recorder(bus, scenario, run, directory)
    status: Literal["complete", "interrupted", "failed"] = "failed"
    try:
        yield recorder
        status = "complete"
    except KeyboardInterrupt:
        status = "interrupted"
        raise
    finally:
        try:
            recorder.close(status)
        except JouleSwarmError as error:
            # What ended the run is worth more than that its end could not be told to a broker that is gone.
            if status == "complete":
                raise
            console.print(f"the run directory has no final counters: {error}", highlight=False)


def _watch(scenario: Scenario, recorder: Recorder, console: Console, launcher: Launcher | None) -> None:
    with View(console, scenario, recorder) as view:
        while recorder.waiting_for:
            recorder.pump(_PUMP_S)
            recorder.check()
            if launcher is not None:
                launcher.check()
            view.update()
