"""A deployment's processes on the workers of a Dask cluster: placed, watched, moved when a worker is gone, ended."""

from __future__ import annotations

import queue
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from distributed import Client, Future
from distributed.scheduler import KilledWorker

from jouleswarm.common.disk.lock import await_free
from jouleswarm.common.errors import ConfigurationError, JouleSwarmError, RunError
from jouleswarm.fleet.placement import placed
from jouleswarm.fleet.worker import Group, run_group
from jouleswarm.runs.directory import MANIFEST

_END_S = 8.0
_ALL = "all"  # Dask's own topic: workers that come and go


class Remote:
    """Context manager: processes started in it are ended when it is left, however it is left.

    A task a worker, with all processes that are placed there. Dask begins a task of a worker that is gone on another
    one, where each process goes on from its state, which is in a folder that all machines share.
    """

    def __init__(
        self,
        client: Client,
        run: Path,
        states: Path,
        restarts: int,
        told: Callable[[str], None],
        *,
        goes_on: bool,
    ) -> None:
        """
        Args:
            client: of the cluster.
            run: the run directory, whose name all that Dask knows of the run begins with.
            states: folder with a folder of each process's state.
            restarts: how often a process that was killed is started again, and a group whose worker was.
            told: a line of what happened.
            goes_on: whether others go on without a robot.
        """
        self._client, self._run, self._states = client, run.resolve(), states.resolve()
        self._restarts, self._told, self._goes_on = restarts, told, goes_on
        self._heard: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._groups: dict[str, Group] = {}
        self._tasks: dict[str, Future] = {}
        self._where: dict[str, str] = {}
        self._moved: Counter[str] = Counter()
        self._topic = f"jouleswarm-{run.name}-{time.time_ns()}"

    def __enter__(self) -> Self:
        for topic in (self._topic, _ALL):
            self._client.subscribe_topic(topic, self._hear)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.cancel(list(self._tasks.values()), force=True)
        deadline_s = time.monotonic() + _END_S
        for name in (name for group in self._groups.values() for name in group.processes):
            try:
                await_free(self._states / name, max(0.0, deadline_s - time.monotonic()), lambda line: None)
            except ConfigurationError as held:
                self._told(str(held))
        for topic in (self._topic, _ALL):
            self._client.unsubscribe_topic(topic)

    def _hear(self, event: tuple[float, Any]) -> None:
        # In Dask's thread.
        if isinstance(event[1], dict):
            self._heard.put(event[1])

    def start(self, processes: Mapping[str, tuple[str, list[str]]]) -> None:
        """Place processes on the workers that there are now, and have them started: name -> module and arguments.

        Raises:
            RunError: there are none any more.
        """
        threads = self._client.nthreads()
        if not threads:
            raise RunError("the Dask cluster has no workers any more; --resume goes on once it has")
        for number, (worker, names) in enumerate(placed(list(processes), threads).items(), start=1):
            self._groups[str(number)] = Group(
                name=str(number),
                processes={name: processes[name] for name in names},
                scenario=self._run / MANIFEST,
                logs=self._run / "logs",
                states=self._states,
                restarts=self._restarts,
                goes_on=self._goes_on,
                topic=self._topic,
            )
            self._submit(str(number), worker)

    def _submit(self, group: str, *workers: str) -> None:
        # Loose: where the worker is gone any other will do.
        where: dict[str, Any] = {"workers": list(workers), "allow_other_workers": True} if workers else {}
        key = f"{self._topic}-{group}-{self._moved[group]}"
        self._tasks[group] = self._client.submit(run_group, self._groups[group], key=key, pure=False, **where)

    def check(self) -> None:
        """Tell what has happened since; have a group begun again whose workers were killed.

        Raises:
            RunError: a process failed, a group was moved too often, or the scheduler is gone.
        """
        while not self._heard.empty():
            self._take(self._heard.get())
        if self._client.status != "running":
            raise RunError("the Dask scheduler is gone, and all that ran on its workers with it; --resume goes on")
        for group, task in list(self._tasks.items()):
            if task.status in ("cancelled", "lost"):
                raise RunError(f"Dask has dropped the task of {self._names(group)}; was the scheduler started again?")
            if task.status == "error":
                self._failed(group, task.exception())

    def _failed(self, group: str, error: BaseException) -> None:
        if isinstance(error, KilledWorker) and self._moved[group] <= self._restarts:
            self._submit(group)  # more often than the scheduler allows by itself
        elif isinstance(error, JouleSwarmError):
            raise error
        else:
            told = " ".join(str(error).split())
            raise RunError(f"{self._names(group)} on {self._where.get(group, 'a worker')}: {told}") from error

    def _take(self, event: Mapping[str, Any]) -> None:
        if event.get("action") == "remove-worker":
            for group in (group for group, worker in self._where.items() if worker == event["worker"]):
                self._told(f"worker {event['worker']} is gone; another one is to go on with {self._names(group)}")
        elif "line" in event:
            self._told(f"worker {self._where[event['group']]}: {event['line']}")
        elif "began" in event:
            self._begun(event["group"], event["began"])

    def _begun(self, group: str, worker: str) -> None:
        is_moved, self._where[group] = group in self._where, worker
        self._moved[group] += is_moved
        self._told(f"worker {worker}{' goes on with' if is_moved else ':'} {self._names(group)}")
        if self._moved[group] > self._restarts:
            raise RunError(f"{self._names(group)}: moved to another worker {self._moved[group]} times")

    def _names(self, group: str) -> str:
        return ", ".join(self._groups[group].processes)
