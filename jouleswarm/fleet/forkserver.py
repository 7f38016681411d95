"""The fork server: loads the libraries once, and draws what all robots see, then forks a process for each order; all
share the memory of these.

Orders come from the launcher over a socket, one line of JSON each; the answers tell which process has begun, and which
has ended with what code. It ends when the launcher ends, however that happens, and all its processes end with it.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import json
import os
import selectors
import signal
import socket
import sys
from typing import NamedTuple

from jouleswarm.common.process import leave_at_once, one_line_errors

PRELOAD = (
    "jouleswarm.agents.__main__",
    "jouleswarm.agents.robot",
    "jouleswarm.codecs.raw",
    "jouleswarm.codecs.trial",
    "jouleswarm.common.bus.joining",
    "jouleswarm.common.scenario.reading",
    "jouleswarm.datacenter.__main__",
    "jouleswarm.datacenter.center",
    "jouleswarm.environments.landmarks.cameras",
    "jouleswarm.environments.landmarks.environment",
    "jouleswarm.environments.landmarks.factory",
    "jouleswarm.methods.consensus",
    "cv2",
    "encodings.idna",  # of every connection
)
"""Loaded before the first fork, all that a robot of a plain scenario needs; none of it starts a thread."""

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


_shared: list[object] = []
"""Held for the processes that are forked."""


class Order(NamedTuple):
    """Run `python -m MODULE ARGUMENTS`, what it prints going to the file `log`."""

    module: str
    arguments: list[str]
    log: str


def main() -> None:
    """Arguments: a descriptor, the socket to the launcher; the launcher's process id; perhaps a scenario file."""
    descriptor, parent, *scenario = sys.argv[1:]
    end_with(int(parent))  # before the libraries are loaded: that takes seconds
    with one_line_errors("fork server"):
        load(*scenario)
    order = serve(socket.socket(fileno=int(descriptor)))
    if order is not None:
        gc.enable()
        run_module(order)


def load(scenario: str | None = None) -> None:
    """Import `PRELOAD`, without garbage collection, and keep it from ever looking at what there is now; and have the
    environment of a scenario make what its robots share.

    Between the imports it would find nothing and take a quarter of their time; in a forked process it would write to
    each object, and so copy all memory that is shared.
    """
    gc.disable()
    for module in PRELOAD:
        importlib.import_module(module)
    if scenario is not None:
        from jouleswarm.common.scenario.reading import load_scenario

        _shared.append(load_scenario(scenario).share())
    gc.freeze()


def serve(launcher: socket.socket) -> Order | None:
    """Fork a process for each order until the launcher is gone; returns None then, and in each process its order."""
    woken, wakes = socket.socketpair()
    for end in (woken, wakes):
        end.setblocking(False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wakes.fileno())
    server, children = os.getpid(), set[int]()
    with launcher, woken, wakes, selectors.DefaultSelector() as selector, launcher.makefile("rb") as orders:
        selector.register(woken, selectors.EVENT_READ)
        selector.register(launcher, selectors.EVENT_READ)
        while True:
            ready = [key.fileobj for key, _ in selector.select()]
            if woken in ready:
                woken.recv(4096)
                _reap(children, launcher)
            if launcher in ready:
                line = orders.readline()
                if not line:
                    break
                child = os.fork()
                if child == 0:
                    signal.set_wakeup_fd(-1)
                    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                    end_with(server)
                    return Order(*json.loads(line))
                children.add(child)
                _tell(launcher, {"began": child})
    for child in children:
        os.kill(child, signal.SIGKILL)
    return None


def _reap(children: set[int], launcher: socket.socket) -> None:
    for child in tuple(children):
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            children.remove(child)
            _tell(launcher, {"ended": child, "code": os.waitstatus_to_exitcode(status)})


def _tell(launcher: socket.socket, answer: dict[str, int]) -> None:
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # gone: the next read says so
        launcher.sendall(json.dumps(answer).encode() + b"\n")


def run_module(order: Order) -> None:
    """Be the process that was ordered."""
    os.setsid()  # a Ctrl-C at the terminal is for the launcher alone, which ends its children itself
    descriptor = os.open(order.log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    for name in ("JOULESWARM_SET", "JOULESWARM_TASK"):  # the scenario has been resolved, and is the same for all
        os.environ.pop(name, None)
    sys.argv = [f"python -m {order.module}", *order.arguments]
    try:
        importlib.import_module(f"{order.module}.__main__").app()
    except SystemExit as end:
        # Without taking the interpreter apart, which would copy all memory that is shared.
        leave_at_once(end.code if isinstance(end.code, int) else int(end.code is not None))


def end_with(parent: int) -> None:
    """The kernel ends this process when its parent ends, at whatever it is then."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # too late
            os._exit(128 + signal.SIGKILL)


if __name__ == "__main__":
    main()
