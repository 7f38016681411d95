"""Recording a run: a recorder from the first process to the end, whoever started the processes."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Protocol

from rich.console import Console

from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.bus.credentials import Credentials, credentials_of
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.errors import JouleSwarmError, RunError, usable
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, encode_json
from jouleswarm.fleet.broker_log import BrokerLog
from jouleswarm.fleet.launcher import Launcher
from jouleswarm.fleet.learning import check_learning
from jouleswarm.fleet.preflight import check_is_new, check_largest_message
from jouleswarm.fleet.recorder import CLIENT, Recorder, Status
from jouleswarm.fleet.stopping import telling_what_is_kept
from jouleswarm.fleet.trial import try_out
from jouleswarm.runs.directory import MANIFEST, STATE, RunDirectory
from jouleswarm.runs.manifest import manifest

_PUMP_S = 0.2


class Intruder(Protocol):
    """Who does harm to a deployment on purpose (see jouleswarm/chaos/intruder.py)."""

    @property
    def tick_s(self) -> float:
        """How long it may be until the next `tick`."""

    def line(self, url: str, launcher: Launcher, recorder: Recorder) -> AbstractContextManager[str]:
        """The broker's URL as the processes are to know it."""

    def tick(self) -> None:
        """Called again and again while the run goes on."""


class View(Protocol):
    """Shows a run while it goes on."""

    def update(self) -> None:
        """Called again and again."""


Viewing = Callable[[Console, Scenario, Recorder], AbstractContextManager[View]]


def record_deployment(
    scenario: Scenario,
    run: str,
    out: Path,
    broker: str,
    console: Console,
    ready_file: Path | None = None,
    keys: Path | None = None,
    view: Viewing | None = None,
) -> Path:
    """Record a run whose processes others start; returns the run directory.

    `ready_file` is written once the recorder listens: from then on the processes may be started.
    """
    parse_url(broker)  # before anything is written
    credentials = credentials_of(keys, CLIENT)
    try_out(scenario)
    with ExitStack() as stack:
        directory = stack.enter_context(begun(out, run, "jouleswarm record", console, with_state=False))
        stack.enter_context(telling_what_is_kept(directory.path))
        stack.enter_context(usable("run directory", directory.path, RunError))
        recorder = stack.enter_context(
            recording(scenario, broker, run, directory, console, credentials, embedded=False)
        )
        if ready_file is not None:
            with usable("--ready-file", ready_file):
                ready_file.touch()
        watch(recorder, stack.enter_context(shown(view, console, scenario, recorder)))
    return directory.path


@contextlib.contextmanager
def begun(out: Path, run: str, who: str, console: Console, *, with_state: bool) -> Iterator[RunDirectory]:
    """A new run directory of one's own, told in the first line that a run prints."""
    path = out / topics.run_name(run)
    with usable("--out", out):
        path.mkdir(parents=True, exist_ok=True)
    with Lock(path, who):
        directory = RunDirectory(path, state=path / STATE / CLIENT if with_state else None)
        say_where(directory, console)
        yield directory


def say_where(directory: RunDirectory, console: Console) -> None:
    console.print(f"run directory: {directory.path}", highlight=False, markup=False, soft_wrap=True)


@contextlib.contextmanager
def recording(
    scenario: Scenario,
    url: str,
    run: str,
    directory: RunDirectory,
    console: Console,
    credentials: Credentials | None,
    state: Path | None = None,
    *,
    embedded: bool,
    launcher: Launcher | None = None,
) -> Iterator[Recorder]:
    """A recorder that writes its summary however the run ends; `state`: folder of all processes' states."""
    described, is_begun = manifest(scenario, run, url, embedded=embedded), (directory.path / MANIFEST).exists()
    if is_begun:
        before = json.loads((directory.path / MANIFEST).read_text(encoding="utf-8"))
        described = {**before, "resumed": [*before.get("resumed", ()), described["started"]]}
    directory.doors(scenario.files)
    directory.manifest(described)
    if not embedded:
        told = f"joining {parse_url(url)}; a broker may take up to {scenario.bus.connect_timeout_s:g} s to come"
        console.print(told, highlight=False, markup=False, soft_wrap=True)
    bus = MqttBus.connect(
        url,
        CLIENT,
        credentials=credentials,
        will=(topics.recorder(run), encode_json(Presence(agent=0, state="gone"))),
        keepalive_s=scenario.bus.keepalive_s,
        connect_timeout_s=scenario.bus.connect_timeout_s,
        meter=Meter("client", state and state / CLIENT),
        # Before its processes are there, and once they are done, nobody else notices that the broker was killed.
        look_after_broker=None if launcher is None else launcher.check_broker,
    )
    try:
        if launcher is not None and not embedded and not is_begun:
            check_is_new(bus, scenario, run)
        check_largest_message(bus, scenario, run)
    except JouleSwarmError:
        bus.close()  # without its last word, which might be heard in a run that is under way
        raise
    recorder = Recorder(bus, scenario, run, directory, state)
    status: Status = "failed"
    try:
        yield recorder
        check_learning(scenario, directory.rows)
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
            console.print(f"no final counters from the broker: {error}", highlight=False, markup=False, soft_wrap=True)


@contextlib.contextmanager
def shown(
    viewing: Viewing | None, console: Console, scenario: Scenario, recorder: Recorder
) -> Iterator[Callable[[], None]]:
    """What shows how a run stands now; of no view it shows nothing."""
    with contextlib.nullcontext() if viewing is None else viewing(console, scenario, recorder) as view:
        yield (lambda: None) if view is None else view.update


def watch(
    recorder: Recorder,
    show: Callable[[], None],
    launcher: Launcher | None = None,
    intruder: Intruder | None = None,
    broker_log: BrokerLog | None = None,
    check: Callable[[], None] | None = None,
) -> None:
    """Until all have handed in what they counted; `check` sees to processes elsewhere, and to who died there."""
    while recorder.waiting_for:
        recorder.pump(_PUMP_S if intruder is None else intruder.tick_s)
        recorder.check(restarted=check is not None)
        if launcher is not None:
            launcher.check()
        if check is not None:
            check()
        if intruder is not None:
            intruder.tick()
        if broker_log is not None:
            broker_log.show()
        show()
