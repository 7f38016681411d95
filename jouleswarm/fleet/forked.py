"""The launcher's side of the fork server: starts it, orders processes, hears how they end."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import wait
from pathlib import Path

from jouleswarm.common.errors import RunError
from jouleswarm.fleet.endings import ending
from jouleswarm.fleet.forkserver import Order
from jouleswarm.fleet.packages import command_of

_START_S = 600.0  # it loads torch first, on a slow disk perhaps
_END_S = 10.0
_LOOK_S = 0.2


class Forked:
    """A process that the fork server has started."""

    def __init__(self, server: ForkServer, pid: int) -> None:
        self._server, self.pid = server, pid
        self.code: int | None = None

    @property
    def exitcode(self) -> int | None:
        """None while it runs; below 0 the signal that ended it."""
        self._server.listen(0)
        return self.code

    def signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.exitcode is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def join(self, seconds: float) -> None:
        """Wait until it has ended, for so long at most."""
        deadline_s = time.monotonic() + seconds
        while self.exitcode is None and not self._server.is_gone and (left_s := deadline_s - time.monotonic()) > 0:
            self._server.listen(left_s)


class ForkServer:
    """One fork server, and the processes that it started. Its own output goes to the file `log`."""

    def __init__(self, log: Path, scenario: Path | None = None) -> None:
        """`scenario`: a file, of what the processes are to share (see `common.scenario.environments`)."""
        self.log, self.is_gone = log, False
        self._children: dict[int, Forked] = {}
        self._begun: list[Forked] = []
        self._heard = b""
        self._socket, theirs = socket.socketpair()
        command = [*command_of("jouleswarm.fleet.forkserver"), str(theirs.fileno()), str(os.getpid())]
        command += [] if scenario is None else [str(scenario)]
        with theirs, log.open("ab") as output:
            # A session of its own: a Ctrl-C at the terminal is for the launcher alone.
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )

    def start(self, order: Order, meanwhile: Callable[[], None] = lambda: None) -> Forked:
        """Have a process started; `meanwhile` is called again and again until it has begun: libraries take seconds.

        Raises:
            RunError: the server is gone, or does not answer.
        """
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._socket.sendall(json.dumps(order).encode() + b"\n")
        deadline_s = time.monotonic() + _START_S
        while not self._begun and not self.is_gone and (left_s := deadline_s - time.monotonic()) > 0:
            self.listen(min(left_s, _LOOK_S))
            meanwhile()
        if not self._begun:
            raise RunError(f"no process could be started: {self.told_end()}")
        return self._begun.pop()

    def listen(self, seconds: float) -> None:
        """Take what the server tells, waiting for so long at most."""
        if self.is_gone or not wait([self._socket], seconds):
            return
        try:
            heard = self._socket.recv(65_536)
        except ConnectionResetError:
            heard = b""
        self.is_gone = not heard
        *lines, self._heard = (self._heard + heard).split(b"\n")
        for line in lines:
            self._take(json.loads(line))

    def _take(self, told: dict[str, int]) -> None:
        if "began" in told:
            child = self._children[told["began"]] = Forked(self, told["began"])
            self._begun.append(child)
        else:
            self._children.pop(told["ended"]).code = told["code"]

    def told_end(self) -> str:
        """How it ended, or that it has not."""
        try:
            code = self._process.wait(_END_S if self.is_gone else 0.0)
        except subprocess.TimeoutExpired:
            return f"the fork server did not answer within {_START_S:g} s; see {self.log}"
        return ending("the fork server", code, self.log)

    def close(self) -> None:
        """End it at once, and with it every process that is left: as if each had been killed."""
        self._process.kill()
        self._process.wait()
        self._socket.close()
        self.is_gone = True
        for pid, child in self._children.items():
            child.code = -signal.SIGKILL
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)  # where the kernel does not
                _wait_for(pid)


def _wait_for(pid: int) -> None:
    if sys.platform == "linux":
        descriptor = os.pidfd_open(pid)
        wait([descriptor], _END_S)
        os.close(descriptor)
