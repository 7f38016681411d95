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

from common.errors import StudyError

_CONFIG: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": 0,  # a job that took its worker down would take the next one down too
    "distributed.worker.use-file-locking": False,
}
_CONNECT_TIMEOUT_S = 30


@contextlib.contextmanager
def connected(scheduler: str | None, workers: int) -> Iterator[Client]:
    """A client of the cluster at `scheduler`, or of `workers` processes started here and ended with the context.

    Raises:
        StudyError: no cluster answers.
    """
    with dask.config.set(_CONFIG):
        if scheduler is not None:
            with _client_of(scheduler) as client:
                yield client
        else:
            with _local_cluster(workers) as cluster, Client(cluster) as client:
                yield client


def _local_cluster(workers: int) -> LocalCluster:
    # A Ctrl-C at the terminal is for this process alone, which ends its workers itself. What is started here,
    # threads and processes, inherits the mask. The tracker comes first: it lets SIGINT through again. Nor is the
    # current folder for them: a `random.py` there is not Python's.
    os.environ.setdefault("PYTHONSAFEPATH", "1")
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


def _client_of(scheduler: str) -> Client:
    try:
        return Client(scheduler, timeout=_CONNECT_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise StudyError(
            f"no Dask scheduler answered at {scheduler!r} ({error}); expected an address like tcp://HOST:8786"
        ) from error
