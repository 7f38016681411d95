"""Faults, and how each is done to a deployment that runs."""

from __future__ import annotations

import contextlib
import os
import random
import resource
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from jouleswarm.chaos.proxy import Proxy, Slowness
from jouleswarm.chaos.ramdisk import RamDisk
from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.disk.lock import LOCK, await_free
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.links import link_of
from jouleswarm.common.wire.topics import Link
from jouleswarm.fleet.launcher import Launcher
from jouleswarm.fleet.packages import command_of
from jouleswarm.runs.directory import STATE
from jouleswarm.runs.traffic import DATA_CENTER

FaultKind = Literal[
    "robot killed",
    "data center killed",
    "broker killed",
    "broker down",
    "broker stopped",
    "robot stopped",
    "weights cut",
    "frame cut",
    "bad link",
    "duplicates",
    "same robot twice",
    "same state twice",
    "same run twice",
    "state torn",
    "run interrupted",
    "state lost",
    "disk full",
]
KINDS: tuple[FaultKind, ...] = get_args(FaultKind)
TWINS: tuple[FaultKind, ...] = ("same robot twice", "same state twice", "same run twice")
"""A second process is started, which must be refused."""

_BAD_LINK = Slowness(bytes_per_s=2e6, cut_odds=0.002)
_REFUSED = 2  # exit code of a configuration error
_END_S = 10.0
_TWIN_S = 60.0  # it loads its libraries first
_STATES = ("state.0", "task-*.0")
_LOG_BYTES = 4096  # so much more a process may write where its disk is full, to say so


@dataclass
class Site:
    """What faults are done to."""

    scenario: Scenario
    launcher: Launcher
    proxy: Proxy
    url: str
    run: str
    options: list[str]
    """Command-line options of the scenario's processes."""
    pause_s: float
    """How long the broker is away, or somebody stopped."""
    rng: random.Random
    onlooker: MqttBus
    path: Path
    """The run directory."""
    disk: RamDisk | None = None
    """Where that is on a disk of its own."""
    here: tuple[str, ...] = ()
    """Processes that have not left yet; empty: not known."""
    told: tuple[int, ...] = ()
    """Robots that have told of a round."""
    heard: dict[str, Message] = field(default_factory=dict)
    later: list[tuple[float, Callable[[], None]]] = field(default_factory=list)
    twins: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def after(self, seconds: float, what: Callable[[], None]) -> None:
        """Do something later, in `tick`."""
        self.later.append((time.monotonic() + seconds, what))

    def tick(self) -> None:
        """Do what is due."""
        while (message := self.onlooker.receive(0)) is not None:
            if link_of(message.topic) not in (None, Link.CONTROL):
                self.heard[message.topic] = message
        now_s = time.monotonic()
        due = [what for at, what in self.later if at <= now_s]
        self.later = [each for each in self.later if each[0] > now_s]
        for what in due:
            what()

    def end(self) -> None:
        """Leave nothing stopped, slow or running."""
        for _, what in self.later:
            what()
        self.later.clear()
        for twin in self.twins:
            twin.kill()
            twin.wait()


def inject(kind: FaultKind, site: Site) -> str | None:
    """Do it; returns whom it was done to, None where there is nobody yet. How a run is ended is up to who runs it."""
    robots = [name for name in site.here if name != DATA_CENTER]
    robot = site.rng.choice(robots or [f"agent-{agent}" for agent in site.scenario.agents])
    match kind:
        case "robot killed":
            return _signal(site, robot, signal.SIGKILL)
        case "data center killed":
            return _signal(site, DATA_CENTER, signal.SIGKILL)
        case "broker killed":
            return _signal(site, "broker", signal.SIGKILL)
        case "broker down":
            site.launcher.hold("broker", site.pause_s)
            return _signal(site, "broker", signal.SIGKILL)
        case "broker stopped":
            return _stopped(site, "broker")
        case "robot stopped":
            return _stopped(site, robot)
        case "weights cut":
            site.proxy.cut_at(b"/weights")
            return "a connection"
        case "frame cut":
            site.proxy.cut_at(b"/experience")
            return "a connection"
        case "bad link":
            site.proxy.slow_down(_BAD_LINK)
            site.after(site.pause_s, lambda: site.proxy.slow_down(None))
            return "all connections"
        case "duplicates":
            return _duplicate(site)
        case "same robot twice":
            return _robot_twice(site, robot)
        case "same state twice":
            return _robot_twice(site, robot, "--state", str(_state(site, robot))) if _owns_state(site, robot) else None
        case "same run twice":
            return _twin(site, "the run", [*command_of("jouleswarm"), "run", "--resume", str(site.path)])
        case "state torn":
            return _tear(site, site.rng.choice([robot, DATA_CENTER]) if DATA_CENTER in site.here else robot)
        case "run interrupted":
            return "everybody"
        case "state lost":
            return f"agent-{site.rng.choice(site.told)}" if site.told else None
        case "disk full":
            return _fill_disk(site, robot)


def _signal(site: Site, name: str, number: int) -> str:
    with contextlib.suppress(ProcessLookupError):
        os.kill(site.launcher.pids[name], number)
    return name


def _stopped(site: Site, name: str) -> str:
    _signal(site, name, signal.SIGSTOP)
    pid = site.launcher.pids[name]

    def go_on() -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)

    site.after(site.pause_s, go_on)
    return name


def _duplicate(site: Site) -> str:
    """Publish again the newest weights, experience and models of everybody."""
    for message in site.heard.values():
        site.onlooker.publish(message.topic, message.payload)
    return f"{len(site.heard)} messages"


def _twin(site: Site, whose: str, command: list[str]) -> str:
    site.twins.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
    return whose


def _robot_twice(site: Site, name: str, *more: str) -> str:
    options = ["--id", name.removeprefix("agent-"), "--broker", site.url, "--run", site.run, *site.options, *more]
    return _twin(site, name, [*command_of("jouleswarm.agents"), *options])


def _state(site: Site, name: str) -> Path:
    return site.path / STATE / name


def _owns_state(site: Site, name: str) -> bool:
    """Whether the process has got hold of its folder: one that is just being started could be overtaken."""
    with contextlib.suppress(OSError):
        return f"process {site.launcher.pids[name]} " in (_state(site, name) / LOCK).read_text(encoding="utf-8")
    return False


def _tear(site: Site, name: str) -> str:
    """Kill a process, and leave its state as if that had been while it wrote it."""
    _signal(site, name, signal.SIGKILL)
    folder = _state(site, name)
    if folder.exists():
        await_free(folder, _END_S, lambda line: None)
    states = sorted(path.with_suffix("") for each in _STATES for path in folder.rglob(each))
    if states:
        StateFile(site.rng.choice(states), None).tear()
    return name


def _fill_disk(site: Site, robot: str) -> str:
    """The whole disk, where the run has one of its own; else no file of a robot may become large any more."""
    if site.disk is not None:
        site.disk.fill()
        return "the disk"
    log = site.path / "logs" / f"{robot}.log"
    size_bytes = _LOG_BYTES + (log.stat().st_size if log.exists() else 0)
    with contextlib.suppress(ProcessLookupError):
        resource.prlimit(site.launcher.pids[robot], resource.RLIMIT_FSIZE, (size_bytes, size_bytes))
    return robot


def refused(twin: subprocess.Popen[bytes], *, wait: bool = False) -> bool | None:
    """Whether a second process was refused; None as long as it runs."""
    if wait:
        with contextlib.suppress(subprocess.TimeoutExpired):
            twin.wait(_TWIN_S)
    code = twin.poll()
    return None if code is None else code == _REFUSED
