"""Faults, and how each is done to a deployment that runs."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, get_args

from common.bus import Message
from common.mqtt import MqttBus
from common.scenario import Scenario
from common.topics import ROOT, Link, link_of
from fleet.launcher import Launcher
from fleet.packages import command_of
from fleet.proxy import Proxy, Slowness
from fleet.traffic import DATA_CENTER

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
]
KINDS: tuple[FaultKind, ...] = get_args(FaultKind)

_BAD_LINK = Slowness(bytes_per_s=2e6, cut_odds=0.002)
_REFUSED = 2  # exit code of a configuration error


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
        for twin in self.twins:
            twin.kill()
            twin.wait()


def inject(kind: FaultKind, site: Site) -> str:
    """Do it; returns whom it was done to."""
    robot = f"agent-{site.rng.choice(site.scenario.agents)}"
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
            return _twin(site, robot)


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


def _twin(site: Site, name: str) -> str:
    agent = name.removeprefix("agent-")
    command = [*command_of("agents"), "--id", agent, "--broker", site.url, "--run", site.run, *site.options]
    site.twins.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
    return name


def onlooker(url: str, run: str, connect_timeout_s: float) -> MqttBus:
    """A client that hears what can be duplicated."""
    bus = MqttBus.connect(url, "onlooker", connect_timeout_s=connect_timeout_s)
    bus.subscribe(f"{ROOT}/{run}/+/sl/#", f"{ROOT}/{run}/+/ul/#", f"{ROOT}/{run}/+/dl/#")
    return bus


def refused(twin: subprocess.Popen[bytes]) -> bool | None:
    """Whether a second process of a robot was refused; None as long as it runs."""
    code = twin.poll()
    return None if code is None else code == _REFUSED
