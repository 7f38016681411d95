"""A whole run from the operator's seat: start the processes (or not), record, report."""

from __future__ import annotations

import contextlib
import datetime
import importlib.metadata
import json
import os
import platform
import secrets
import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

from rich.console import Console

from common import topics
from common.errors import ConfigurationError, JouleSwarmError
from common.keys import Credentials, credentials_of
from common.meter import Meter
from common.mqtt import MqttBus, parse_url
from common.payloads import Presence, encode_json
from common.runlog import MANIFEST, STATE, RunDirectory
from common.scenario import Scenario, load_scenario
from fleet.launcher import Launcher
from fleet.recorder import CLIENT, Recorder
from fleet.resume import check_states
from fleet.summary import SCHEMA
from fleet.traffic import DATA_CENTER
from fleet.view import View

_PACKAGES = ("amqtt", "gymnasium", "numpy", "opencv-python-headless", "paho-mqtt", "safetensors", "torch")
_PUMP_S = 0.2
RESTARTS = 20


class Intruder(Protocol):
    """Who does harm to a deployment on purpose (see fleet/chaos.py)."""

    def line(self, url: str, launcher: Launcher, recorder: Recorder) -> AbstractContextManager[str]:
        """The broker's URL as the processes are to know it."""

    def tick(self) -> None:
        """Called a few times a second while the run goes on."""


def new_run_id(scenario: Scenario) -> str:
    """A name no other run has."""
    now = datetime.datetime.now(datetime.UTC).strftime("%Y%m%d-%H%M%S")
    return f"{scenario.name}-{now}-{secrets.token_hex(2)}"


@dataclass(frozen=True)
class Options:
    """How the processes of a deployment are started."""

    broker: str | None = None
    """URL of the broker to use; None starts an embedded one."""
    keys: Path | None = None
    """Folder that all take their user, password and certificates from."""
    restarts: int = RESTARTS
    """How often a process that was killed is started again."""
    durable: bool = False
    """Whether each round is on the disk, for a power failure, before it goes on."""
    intruder: Intruder | None = None
    """Who may interfere."""


def run_deployment(
    scenario: Scenario,
    scenario_options: list[str],
    run: str,
    out: Path,
    console: Console,
    options: Options = Options(),  # it is frozen
) -> Path:
    """Run a scenario in processes of its own on this machine; returns the run directory.

    `scenario_options` are the command-line options that make every process load this same scenario.
    """
    _check(scenario, options)  # before anything is written
    directory = RunDirectory(out / topics.run_name(run))
    _deploy(scenario, scenario_options, run, directory, console, options)
    return directory.path


def resume_deployment(path: Path, console: Console, options: Options = Options()) -> Path:
    """Go on with a run of `run_deployment` that was interrupted at any moment; returns its directory.

    Raises:
        ConfigurationError: it is complete, not the directory of such a run, or lacks the state of a process.
    """
    held = path / MANIFEST
    scenario = load_scenario(held)
    if not (path / STATE).is_dir():
        raise ConfigurationError(f"run {path}: has no {STATE}/: it is complete, or was only recorded; see its report")
    _check(scenario, options)
    name = str(json.loads(held.read_text(encoding="utf-8"))["run"])
    check_states(path)  # before anything is written
    directory = RunDirectory(path, resume=True)
    _deploy(scenario, ["--scenario", str(held.resolve())], name, directory, console, options)
    return path


def _check(scenario: Scenario, options: Options) -> None:
    if options.broker is not None:
        parse_url(options.broker)
    for agent in scenario.agents:
        credentials_of(options.keys, f"agent-{agent}")


def _deploy(
    scenario: Scenario,
    scenario_options: list[str],
    run: str,
    directory: RunDirectory,
    console: Console,
    options: Options,
) -> None:
    state, intruder = directory.path / STATE, options.intruder
    keys = [] if options.keys is None else ["--keys", str(options.keys.resolve())]
    goes_on = scenario.federation.on_missing == "proceed"
    with ExitStack() as stack:
        launcher = stack.enter_context(
            Launcher(
                directory.path / "logs",
                options.restarts,
                partial(console.print, highlight=False),
                may_miss=lambda name: goes_on and name.startswith("agent-"),
            )
        )
        url = options.broker or _embedded_broker(launcher, console, ["--state", str(state / "broker"), *keys])
        embedded, credentials = options.broker is None, credentials_of(options.keys, CLIENT)
        recording = _recording(scenario, url, run, directory, console, credentials, state, embedded=embedded)
        recorder = stack.enter_context(recording)
        line = url if intruder is None else stack.enter_context(intruder.line(url, launcher, recorder))
        common = ["--broker", line, *keys, "--run", run, *scenario_options, "--keep-state"]
        common += ["--durable"] if options.durable else []
        if scenario.needs_datacenter:
            launcher.start(DATA_CENTER, "datacenter", [*common, "--state", str(state / DATA_CENTER)])
        for agent in scenario.agents:
            name = f"agent-{agent}"
            launcher.start(name, "agents", ["--id", str(agent), *common, "--state", str(state / name)])
        _watch(scenario, recorder, console, launcher, intruder)
    shutil.rmtree(state)


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
    state: Path | None = None,
    *,
    embedded: bool,
) -> Iterator[Recorder]:
    """A recorder that writes its summary however the run ends; `state`: folder of all processes' states."""
    described = manifest(scenario, run, url, embedded=embedded)
    if (directory.path / MANIFEST).exists():
        before = json.loads((directory.path / MANIFEST).read_text(encoding="utf-8"))
        described = {**before, "resumed": [*before.get("resumed", ()), described["started"]]}
    directory.manifest(described)
    bus = MqttBus.connect(
        url,
        CLIENT,
        credentials=credentials,
        will=(topics.recorder(run), encode_json(Presence(agent=0, state="gone"))),
        keepalive_s=scenario.bus.keepalive_s,
        connect_timeout_s=scenario.bus.connect_timeout_s,
        meter=Meter("client", state and state / CLIENT),
    )
    recorder = Recorder(bus, scenario, run, directory, state)
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


def _watch(
    scenario: Scenario,
    recorder: Recorder,
    console: Console,
    launcher: Launcher | None,
    intruder: Intruder | None = None,
) -> None:
    with View(console, scenario, recorder) as view:
        while recorder.waiting_for:
            recorder.pump(_PUMP_S)
            recorder.check()
            if launcher is not None:
                launcher.check()
            if intruder is not None:
                intruder.tick()
            view.update()
