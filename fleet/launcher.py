"""Starts a deployment's processes on this machine, watches them, and leaves none behind."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from multiprocessing import forkserver, resource_tracker
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from common.errors import RunError

# Loaded once in the fork server; every process then shares the memory of these.
_PRELOAD = ["fleet.child", "agents.__main__", "agents.agent", "datacenter.__main__", "datacenter.server", "common.mqtt"]
_GRACE_S = 2.0
_ARITHMETIC_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Launcher:
    """Context manager: processes started in it are ended when it is left, however it is left."""

    def __init__(
        self,
        logs: Path,
        restarts: int = 0,
        told: Callable[[str], None] = lambda line: None,
        may_miss: Callable[[str], bool] = lambda name: False,
    ) -> None:
        """A process that a signal has ended is started again up to `restarts` times, and `told` in a line.

        Then that is an error, unless the others go on without it: `may_miss`.
        """
        self._logs, self._restarts, self._told, self._may_miss = logs, restarts, told, may_miss
        self._missed: set[str] = set()
        logs.mkdir(parents=True, exist_ok=True)
        self._broker: subprocess.Popen[str] | None = None
        self._broker_command: list[str] = []
        self._children: dict[str, ForkServerProcess] = {}
        self._commands: dict[str, tuple[str, list[str]]] = {}
        self._restarted: Counter[str] = Counter()
        self._held: dict[str, float] = {}
        # Before numpy and torch are loaded: a pool of threads made before a fork is of no use after it.
        for variable in _ARITHMETIC_THREADS:
            os.environ.setdefault(variable, "1")
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(_PRELOAD)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for child in self._children.values():
            if child.is_alive():
                child.terminate()
        for child in self._children.values():
            child.join(_GRACE_S)
            if child.is_alive():
                child.kill()
                child.join()
        _end_fork_server()
        if self._broker is not None:
            self._broker.terminate()
            try:
                self._broker.wait(_GRACE_S)
            except subprocess.TimeoutExpired:
                self._broker.kill()
                self._broker.wait()

    def start_broker(self, arguments: Sequence[str] = ()) -> dict[str, str]:
        """Start the embedded broker on a free port of this machine; returns its URLs.

        Raises:
            RunError: it ended before it listened.
        """
        command = [sys.executable, "-m", "broker", "--exit-with-stdin", *arguments]
        ready = self._run_broker([*command, "--port", "0", "--metrics-port", "0"])
        ports = {"--port": ready["url"], "--metrics-port": (ready["metrics"] or ":0").removesuffix("/metrics")}
        # The next one, if there must be one, is where this one was.
        self._broker_command = [*command, *(part for key, url in ports.items() for part in (key, url.split(":")[-1]))]
        return ready

    def _run_broker(self, command: list[str]) -> dict[str, str]:
        with (self._logs / "broker.log").open("ab") as log:
            self._broker = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True
            )
        assert self._broker.stdout is not None
        line = self._broker.stdout.readline()
        if not line:
            self._broker.wait()
            raise RunError(f"the broker ended with code {self._broker.returncode}: {self._tail('broker')}")
        ready: dict[str, str] = json.loads(line)
        return ready

    def start(self, name: str, module: str, arguments: list[str]) -> None:
        """Start `python -m MODULE ARGUMENTS` as a process called `name`."""
        from fleet.child import run_module

        _ensure_fork_server()
        child = self._context.Process(
            target=run_module, args=(module, arguments, self._log(name)), name=name, daemon=True
        )
        child.start()
        self._children[name], self._commands[name] = child, (module, arguments)

    def check(self) -> None:
        """Notice a process that died: start it again if a signal ended it, also one that it ended itself by.

        Raises:
            RunError: one ended with an error, or too often; the message holds the end of what it printed.
        """
        ended = {name: child.exitcode for name, child in self._children.items() if child.exitcode}
        if self._broker is not None and self._broker.poll() is not None:
            ended["broker"] = self._broker.returncode
        for name, code in ended.items():
            number = signal_of(name, code)
            if number is None:
                raise RunError(f"{name} ended with code {code}: {self._tail(name)}")
            if self._restarted[name] >= self._restarts:
                if not self._may_miss(name):
                    raise RunError(
                        f"{name} ended with code {code}, by {number.name} from outside, and was started again "
                        f"{self._restarted[name]} times: {self._tail(name)}"
                    )
                self._miss(name, number)
            elif time.monotonic() >= self._held.get(name, 0.0):
                self._restart(name, number)

    def _miss(self, name: str, number: signal.Signals) -> None:
        if name not in self._missed:
            self._missed.add(name)
            self._told(f"{name} was ended by {number.name}; the others go on without it")

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
    def pids(self) -> dict[str, int]:
        """Process ids by name."""
        pids = {name: child.pid for name, child in self._children.items() if child.pid is not None}
        return pids | ({"broker": self._broker.pid} if self._broker is not None else {})

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"

    def _tail(self, name: str) -> str:
        lines = self._log(name).read_text(errors="replace").strip().splitlines() if self._log(name).exists() else []
        return lines[-1] + f" (all of it: {self._log(name)})" if lines else "it printed nothing"


def signal_of(name: str, code: int) -> signal.Signals | None:
    """The signal that ended a process: at once, or told by its exit code (see common/process.py)."""
    if name == "broker" and code == 0:  # it ends in good order, and only when it is told to
        return signal.SIGTERM
    number = -code if code < 0 else code - 128
    return signal.Signals(number) if number in signal.valid_signals() and number > 0 else None


def _ensure_fork_server() -> None:
    # A Ctrl-C at the terminal is for all in the foreground; the fork server must not hear it while it loads torch.
    resource_tracker.ensure_running()  # first: it lets SIGINT through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_fork_server() -> None:
    # It would first finish loading torch, then fork the process that a `start` cut short by Ctrl-C had asked for.
    # Such a process, unknown here, ends with it.
    server: Any = forkserver._forkserver
    if server._forkserver_pid is not None:
        os.kill(server._forkserver_pid, signal.SIGKILL)
        server._stop()
