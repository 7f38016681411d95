"""What a Dask worker does in a deployment: one task, which starts processes there, watches them, and ends them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from distributed import Reschedule, get_worker, secede

from jouleswarm.common.disk.lock import is_held
from jouleswarm.common.errors import RunError
from jouleswarm.fleet.launcher import Launcher

_LOOK_EVERY_S = 0.2
_STATE_FREE_S = 60.0
_WANTED = ("executing", "long-running")
_AT_WORK = ("running", "paused")


@dataclass(frozen=True)
class Group:
    """The processes of one task, and how they are started. Paths are of a folder that all machines share."""

    name: str
    processes: Mapping[str, tuple[str, list[str]]]
    """Process -> module and arguments."""
    scenario: Path
    """File of it, as in their arguments."""
    logs: Path
    states: Path
    """Folder with each process's state, by its name."""
    restarts: int
    goes_on: bool
    """Whether others go on without a robot that was killed too often."""
    topic: str
    """Of Dask's events, that what happens is told by."""

    def may_miss(self, name: str) -> bool:
        """Whether the others go on without this process."""
        return self.goes_on and name.startswith("agent-")


class _NotWantedError(Exception):
    """The run was stopped, or the worker is to go."""


def run_group(group: Group) -> None:
    """The task: returns when all processes of the group have ended well.

    It holds no thread of the worker's pool, so that a worker of one thread takes up another's group too. It ends, and
    all its processes with it, when the task is cancelled, which Dask also does when whoever started it is gone; when
    the worker is asked to leave, another one begins it anew.

    Raises:
        RunError: a process ended with an error, or was killed too often, or still runs where it was before.
    """
    worker = get_worker()
    key = worker.get_current_task()
    secede()
    told = partial(_tell, worker, group)
    look = partial(_check_wanted, worker, key)
    told(began=worker.address)
    try:
        with Launcher(
            group.logs,
            group.restarts,
            lambda line: told(line=line),
            group.may_miss,
            fork_server=f"fork-server-{group.name}",
            scenario=group.scenario,
        ) as launcher:
            launcher.meanwhile = look
            _await_free(group, look, told)
            for name, (module, arguments) in group.processes.items():
                launcher.start(name, module, arguments)
            while launcher.is_at_work:
                look()
                launcher.check()
                time.sleep(_LOOK_EVERY_S)
    except _NotWantedError:
        if worker.status.name not in _AT_WORK:
            raise Reschedule from None


def _await_free(group: Group, look: Callable[[], None], told: Callable[..., None]) -> None:
    """Wait for the processes of a worker that lost its way to the scheduler, and not yet its life."""
    until_s, is_told = time.monotonic() + _STATE_FREE_S, False
    while held := [name for name in group.processes if is_held(group.states / name)]:
        names = ", ".join(held)
        if time.monotonic() > until_s:
            raise RunError(
                f"{names}: still at work on a worker that the scheduler lost; end them, then --resume the run"
            )
        if not is_told:
            told(line=f"waiting for {names} to end where it was before")
            is_told = True
        look()
        time.sleep(_LOOK_EVERY_S)


def _check_wanted(worker: Any, key: str) -> None:
    task = worker.state.tasks.get(key)
    if task is None or task.state not in _WANTED or worker.status.name not in _AT_WORK:
        raise _NotWantedError


def _tell(worker: Any, group: Group, **what: str) -> None:
    worker.log_event(group.topic, {"group": group.name, **what})
