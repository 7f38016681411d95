"""Where jobs run: worker processes on this machine, or a Dask cluster of the user's."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
from collections.abc import Iterator
from multiprocessing import resource_tracker
from typing import Any

import dask
from distributed import Client, LocalCluster

from jouleswarm.common.errors import StudyError
from jouleswarm.fleet.scheduler import client_of

_CONFIG: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": 0,  # a job that took its worker down would take the next one down too
    "distributed.worker.use-file-locking": False,
    # Dask's watching of itself, 50 times a second in each process, took 5% of two cores from the deployments.
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.worker.profile.enabled": False,
}
_SAFE_PATH = "PYTHONSAFEPATH"


@contextlib.contextmanager
def connected(scheduler: str | None, workers: int) -> Iterator[Client]:
    """A client of the cluster at `scheduler`, or of `workers` processes started here and ended with the context.

    Raises:
        StudyError: no cluster answers.
    """
    with dask.config.set(_CONFIG):
        if scheduler is not None:
            with client_of(scheduler, StudyError) as client:
                yield client
        else:
            with _safe_path(), _local_cluster(workers) as cluster, Client(cluster) as client:
                yield client


@contextlib.contextmanager
def _safe_path() -> Iterator[None]:
    """The current folder is not for the workers, also for those that Dask starts again: a `random.py` there is not
    Python's. Whatever else this process starts later is not concerned."""
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = before or "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before


def _local_cluster(workers: int) -> LocalCluster:
    # A Ctrl-C at the terminal is for this process alone, which ends its workers itself. What is started here,
    # threads and processes, inherits the mask. The tracker comes first: it lets SIGINT through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=0,  # what is large is in processes of the deployment, which Dask does not see
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
