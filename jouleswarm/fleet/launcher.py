"""Starts a deployment's processes on this machine, watches them, and leaves none behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Sequence
from multiprocessing.connection import wait
from pathlib import Path
from types import TracebackType
from typing import Self

from jouleswarm.common.errors import ConfigurationError, RemovedError, RunError
from jouleswarm.fleet.endings import ending, signal_of
from jouleswarm.fleet.forked import Forked, ForkServer
from jouleswarm.fleet.forkserver import Order
from jouleswarm.fleet.packages import command_of

_GRACE_S = 2.0
_BROKER_START_S = 60.0
_ARITHMETIC_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Launcher:
    """Context manager: processes started in it are ended when it is left, however it is left."""

    def __init__(
        self,
        logs: Path,
        restarts: int = 0,
        told: Callable[[str], None] = lambda line: None,
        may_miss: Callable[[str], bool] = lambda name: False,
        fork_server: str = "fork-server",
        scenario: Path | None = None,
    ) -> None:
        """A process that a signal has ended is started again up to `restarts` times, and `told` in a line.

        Then that is an error, unless the others go on without it: `may_miss`. `fork_server`: name of its log;
        `scenario`: the file that the processes are told of.
        """
        self._logs, self._restarts, self._told, self._may_miss = logs, restarts, told, may_miss
        self._fork_server, self._scenario = fork_server, scenario
        self.meanwhile: Callable[[], None] = lambda: None
        """Called again and again while a process is started."""
        self._missed: set[str] = set()
        logs.mkdir(parents=True, exist_ok=True)
        self._broker: subprocess.Popen[str] | None = None
        self._broker_command: list[str] = []
        self._server: ForkServer | None = None
        self._children: dict[str, Forked] = {}
        self._commands: dict[str, tuple[str, list[str]]] = {}
        self._restarted: Counter[str] = Counter()
        self._held: dict[str, float] = {}
        # Before numpy and torch are loaded: a pool of threads made before a fork is of no use after it.
        for variable in _ARITHMETIC_THREADS:
            os.environ.setdefault(variable, "1")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for child in self._children.values():
            child.signal(signal.SIGTERM)
        deadline_s = time.monotonic() + _GRACE_S
        for child in self._children.values():
            child.join(deadline_s - time.monotonic())
        if self._server is not None:
            self._server.close()  # and whoever is left with it, also one that a `start` cut short had asked for
        if self._broker is not None:
            self._broker.terminate()
            try:
                self._broker.wait(_GRACE_S)
            except subprocess.TimeoutExpired:
                self._broker.kill()
                self._broker.wait()

    def start_broker(self, arguments: Sequence[str] = (), port: int = 0) -> dict[str, str]:
        """Start the embedded broker, on a free port (0), with metrics on a free one unless arguments name another.

        Returns its URLs.

        Raises:
            ConfigurationError: it can't be started so.
            RunError: it ended before it listened.
        """
        command = [*command_of("jouleswarm.broker"), "--exit-with-stdin", "--metrics-port", "0", *arguments]
        ready = self._run_broker([*command, "--port", str(port)])
        ports = {"--port": ready["url"], "--metrics-port": (ready["metrics"] or ":0").removesuffix("/metrics")}
        # The next one, if there must be one, is where this one was.
        self._broker_command = [*command, *(part for key, url in ports.items() for part in (key, url.split(":")[-1]))]
        return ready

    def _run_broker(self, command: list[str]) -> dict[str, str]:
        with self._log("broker").open("ab") as log:
            self._broker = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True
            )
        assert self._broker.stdout is not None
        if not wait([self._broker.stdout.fileno()], _BROKER_START_S):
            raise RunError(f"the broker did not listen within {_BROKER_START_S:g} s; see {self._log('broker')}")
        line = self._broker.stdout.readline()
        if not line:
            code = self._broker.wait()
            error = ConfigurationError if code == ConfigurationError.exit_code else RunError
            raise error(ending("the broker", code, self._log("broker")))
        ready: dict[str, str] = json.loads(line)
        return ready

    def start(self, name: str, module: str, arguments: list[str]) -> None:
        """Start `python -m MODULE ARGUMENTS` as a process called `name`.

        Raises:
            RunError: the fork server ended, or does not answer.
        """
        if self._server is None:
            self._server = ForkServer(self._log(self._fork_server), self._scenario)
        self._children[name] = self._server.start(Order(module, arguments, str(self._log(name))), self.meanwhile)
        self._commands[name] = module, arguments

    def check(self) -> None:
        """Notice a process that died: start it again if a signal ended it, also one that it ended itself by.

        Raises:
            RunError: one ended with an error, or too often; the message holds the end of what it printed.
        """
        self._check_fork_server()
        for name, code in [(name, child.exitcode) for name, child in self._children.items()]:
            if code:
                self._ended(name, code)
        self.check_broker()

    def check_broker(self) -> None:
        """Notice that the broker died, as `check` does: also once nobody waits for the processes any more.

        Raises:
            RunError: as `check`.
        """
        if self._broker is not None and self._broker.poll() is not None:
            self._ended("broker", self._broker.returncode)

    def _ended(self, name: str, code: int) -> None:
        if code == RemovedError.exit_code and self._may_miss(name):
            self._miss(name, "is no user of the broker any more")
            return
        number = signal_of(code, is_broker=name == "broker")
        if number is None or (self._restarted[name] >= self._restarts and not self._may_miss(name)):
            raise RunError(ending(name, code, self._log(name), self._restarted[name]))
        if self._restarted[name] >= self._restarts:
            self._miss(name, f"was ended by {number.name}")
        elif time.monotonic() >= self._held.get(name, 0.0):
            self._restart(name, number)

    def _check_fork_server(self) -> None:
        """If it is gone, so are all its processes: they are started again as if each had been killed."""
        if self._server is None:
            return
        self._server.listen(0)
        if self._server.is_gone:
            told = self._server.told_end()
            self._restarted[self._fork_server] += 1
            if self._restarted[self._fork_server] > self._restarts:
                raise RunError(told)
            self._told(f"{told}; starting it and its processes again")
            self._server.close()
            self._server = None

    def _miss(self, name: str, why: str) -> None:
        if name not in self._missed:
            self._missed.add(name)
            self._told(f"{name} {why}; the others go on without it")

    def hold(self, name: str, seconds: float) -> None:
        """Do not start a process again before so many seconds are over."""
        self._held[name] = time.monotonic() + seconds

    def _restart(self, name: str, number: signal.Signals) -> None:
        self._restarted[name] += 1
        self._told(f"{name} was ended by {number.name}; starting it again")
        if name == "broker":
            self._run_broker(self._broker_command)
        else:
            self.start(name, *self._commands[name])

    @property
    def is_at_work(self) -> bool:
        """Whether a process has not ended well yet, but for those that others go on without."""
        return any(child.exitcode != 0 for name, child in self._children.items() if name not in self._missed)

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name."""
        pids = {name: child.pid for name, child in self._children.items()}
        return pids | ({"broker": self._broker.pid} if self._broker is not None else {})

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"
