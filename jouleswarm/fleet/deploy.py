"""A whole run from the operator's seat: start the processes (or not), record, report."""

from __future__ import annotations

import datetime
import resource
import secrets
import shutil
import subprocess
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.bus.credentials import credentials_of
from jouleswarm.common.disk.lock import Lock, await_free
from jouleswarm.common.disk.verify import check_states
from jouleswarm.common.errors import ConfigurationError, RunError, usable
from jouleswarm.common.host import moved
from jouleswarm.common.meter.power import told as how_measured
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.fleet.broker_log import BrokerLog
from jouleswarm.fleet.launcher import Launcher
from jouleswarm.fleet.more_rounds import MoreRounds, has_ends
from jouleswarm.fleet.packages import command_of
from jouleswarm.fleet.place import Place, place_of, processes_of
from jouleswarm.fleet.recorder import CLIENT, Recorder
from jouleswarm.fleet.recording import Intruder, Viewing, begun, recording, say_where, shown, watch
from jouleswarm.fleet.resume import check_is_there
from jouleswarm.fleet.stopping import telling_what_is_kept
from jouleswarm.fleet.trial import try_out
from jouleswarm.runs.directory import MANIFEST, STATE, RunDirectory, computed_on
from jouleswarm.runs.events import Event, note_event
from jouleswarm.runs.files import other_version, run_manifest
from jouleswarm.runs.traffic import DATA_CENTER

_BROKER_FILES = 16  # beside one a client
RESTARTS = 20
_WAIT_FOR_CHILDREN_S = 10.0
_GLANCE_S = 0.01


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
    other_processor: bool = False
    """Whether a run may be gone on with elsewhere than where it was begun."""
    keep_state: bool = False
    """Whether all states are left, and how each arm ended, for more rounds."""
    intruder: Intruder | None = None
    """Who may interfere."""
    view: Viewing | None = None
    """What shows the run while it goes on."""
    scheduler: str | None = None
    """Address of the Dask scheduler on whose workers robots and data center run; None: on this machine."""
    listen: str | None = None
    """HOST:PORT that the embedded broker listens on; None: where its processes, and nobody else, can reach it."""

    def place(self, folder: Path) -> AbstractContextManager[Place]:
        """Where all runs, and can write to `folder`; a cluster is connected to as long as the context lasts."""
        return place_of(self.scheduler, folder, self.listen, self.broker, with_keys=self.keys is not None)


def run_deployment(
    scenario: Scenario,
    run: str,
    out: Path,
    console: Console,
    options: Options = Options(),  # it is frozen
) -> Path:
    """Run a scenario in processes of its own, on this machine or a cluster's; returns the run directory.

    They read the scenario from the manifest there, so that nothing that happens to the user's file changes the run.
    """
    _check(scenario, options)  # before anything is written
    with options.place(out) as place, begun(out, run, "jouleswarm run", console, with_state=True) as directory:
        _deploy(scenario, run, directory, console, options, place)
    return directory.path


def resume_deployment(
    path: Path, console: Console, options: Options = Options(), more: MoreRounds | None = None
) -> Path:
    """Go on with a run of `run_deployment` that was interrupted at any moment, or with a complete one for `more`
    rounds; returns its directory.

    Raises:
        ConfigurationError: it is complete, not the directory of such a run, lacks the state of a process, or somebody
            is at work on it.
        RunError: something of it is not as it was written, or another version wrote it; nothing has been started.
    """
    manifest, held = run_manifest(path), path / MANIFEST
    if other := other_version(manifest):
        raise RunError(f"run {path}: {other}; go on with the version that began it")
    if not (path / STATE).is_dir():
        raise ConfigurationError(f"run {path}: has no {STATE}/: it is complete, or was only recorded; see its report")
    with options.place(path) as place, Lock(path, "jouleswarm run --resume"):
        for folder in sorted((path / STATE).iterdir()):  # a launcher that was killed may have been outlived
            await_free(folder, _WAIT_FOR_CHILDREN_S, partial(console.print, highlight=False))
        check_is_there(path)
        check_states(path / STATE)
        if options.scheduler is None:  # else each process looks itself, where it is
            _check_processor(manifest, path, options, console)
        with usable("run directory", path):
            directory = RunDirectory(path, resume=True, state=path / STATE / CLIENT)
        if more is not None:
            more.begin(directory)
        scenario = load_scenario(held)
        _check(scenario, options)
        say_where(directory, console)
        _deploy(scenario, manifest["run"], directory, console, options, place)
    return path


def _check_processor(manifest: dict[str, Any], path: Path, options: Options, console: Console) -> None:
    """Hold this machine against the one on which a run was begun, or last gone on with."""
    noted = computed_on(manifest)
    before = {processors[-1] for client, processors in noted.items() if client != DATA_CENTER}  # which may have CUDA
    if not before:
        return
    here = _arithmetic_here()
    for other in before - {here}:
        if not options.other_processor:
            raise ConfigurationError(f"run {path}: {moved(other, here)}")
        console.print(f"begun on {other}; going on on {here}", highlight=False, soft_wrap=True)


def _arithmetic_here() -> str:
    # In a process of its own: this one does not load PyTorch.
    asked = subprocess.run(command_of("jouleswarm.common.host"), capture_output=True, text=True, check=False)
    if asked.returncode:
        raise RunError(f"cannot tell what is computed on here: {asked.stderr.strip().splitlines()[-1:]}")
    return asked.stdout.strip()


def _check(scenario: Scenario, options: Options) -> None:
    if options.broker is not None:
        parse_url(options.broker)
    else:
        have_open_files(len(scenario.agents) + scenario.needs_datacenter + 1)
    for agent in scenario.agents:
        credentials_of(options.keys, f"agent-{agent}")
    try_out(scenario)


def have_open_files(clients: int) -> None:
    """Raise the limit on open files, which the broker inherits, as far as so many clients need.

    Raises:
        ConfigurationError: it may not be raised so far.
    """
    (soft, allowed), needed = resource.getrlimit(resource.RLIMIT_NOFILE), _BROKER_FILES + clients
    if resource.RLIM_INFINITY != allowed < needed:
        raise ConfigurationError(
            f"open files: a process may have {allowed}, expected {needed} or more, for the broker's connections to "
            f"{clients} clients; raise `ulimit -Hn`"
        )
    if resource.RLIM_INFINITY != soft < needed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, allowed))


def _deploy(
    scenario: Scenario,
    run: str,
    directory: RunDirectory,
    console: Console,
    options: Options,
    place: Place,
) -> None:
    state, intruder = directory.path / STATE, options.intruder
    keeps_ends = options.keep_state or has_ends(directory.path)  # also of a run that is gone on with
    keys = [] if options.keys is None else ["--keys", str(options.keys.resolve())]
    goes_on = scenario.federation.on_missing == "proceed"
    with ExitStack() as stack:
        stack.enter_context(telling_what_is_kept(directory.path))
        stack.enter_context(usable("run directory", directory.path, RunError))
        told, manifest = partial(_tell, console, directory.path), (directory.path / MANIFEST).resolve()
        launcher = stack.enter_context(
            Launcher(
                directory.path / "logs",
                options.restarts,
                told,
                may_miss=lambda name: goes_on and name.startswith("agent-"),
                scenario=manifest,
            )
        )
        remote = stack.enter_context(place.begun(directory.path, state, options.restarts, told, goes_on=goes_on))
        if scenario.measure.energy:
            console.print(how_measured(scenario.measure), highlight=False, markup=False, soft_wrap=True)
        broker_log = BrokerLog(directory.path / "logs" / "broker.log", told)
        stack.callback(broker_log.show)
        url = options.broker or place.broker(launcher, console, ["--state", str(state / "broker"), *keys])
        embedded, credentials = options.broker is None, credentials_of(options.keys, CLIENT)
        recorder_at_work = recording(
            scenario, url, run, directory, console, credentials, state, embedded=embedded, launcher=launcher
        )
        recorder = stack.enter_context(recorder_at_work)
        line = url if intruder is None else stack.enter_context(intruder.line(url, launcher, recorder))
        show = stack.enter_context(shown(options.view, console, scenario, recorder))
        launcher.meanwhile = partial(_look, recorder, show)
        common = ["--broker", line, *keys, "--run", run, "--scenario", str(manifest), "--keep-state", "--quiet"]
        common += ["--durable"] if options.durable or remote else []  # another machine sees what is on the disk
        common += ["--other-processor"] if options.other_processor else []
        common += ["--keep-ends"] if keeps_ends else []
        processes = processes_of(scenario, state.resolve(), common)
        if remote is None:
            for name, (module, arguments) in processes.items():
                launcher.start(name, module, arguments)
        else:
            remote.start(processes)
        watch(recorder, show, launcher, intruder, broker_log, None if remote is None else remote.check)
    if not keeps_ends:
        shutil.rmtree(state)


def _look(recorder: Recorder, show: Callable[[], None]) -> None:
    """Who has come by now, while others are still being started."""
    recorder.pump(_GLANCE_S)
    show()


def _tell(console: Console, run: Path, line: str) -> None:
    """What happened, to who looks on now and to who looks later."""
    console.print(line, highlight=False, markup=False, soft_wrap=True)
    with suppress(OSError):  # nobody's bill is of it: no reason to end a run
        note_event(run, Event(time_s=round(time.time(), 3), text=line))
