"""A Dask cluster of the user's: its scheduler and workers, and whether a deployment can run there."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import tempfile
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from urllib.parse import urlsplit

from distributed import Client
from distributed.comm import resolve_address
from distributed.utils import get_ip

from jouleswarm.common.errors import ConfigurationError, JouleSwarmError

_CONNECT_TIMEOUT_S = 10
_WORKERS_TIMEOUT_S = 30
_EXPECTED = "an address like tcp://HOST:8786"


def client_of(scheduler: str, kind: type[JouleSwarmError] = ConfigurationError) -> Client:
    """A client of the scheduler at this address.

    Raises:
        JouleSwarmError: of this kind, none answers.
    """
    for name in (
        "distributed",
        "distributed.client",
        "tornado.application",
    ):  # what goes wrong is told in one line, by who asked
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        return Client(resolve_address(scheduler), timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        told = " ".join(str(error).split())
        raise kind(f"no Dask scheduler answered at {scheduler!r} ({told}); expected {_EXPECTED}") from error


@contextlib.contextmanager
def cluster_of(scheduler: str) -> Iterator[Client]:
    """A client of a cluster that has workers, all with this version of JouleSwarm.

    Raises:
        ConfigurationError: no scheduler answers, no worker comes, or one has another version.
    """
    with client_of(scheduler) as client:
        try:
            client.wait_for_workers(1, timeout=_WORKERS_TIMEOUT_S)
        except TimeoutError:
            raise ConfigurationError(
                f"the Dask scheduler at {scheduler} has no workers; start some with `dask worker {scheduler}`, and "
                "wait for them"
            ) from None
        check_versions(client.run(version, "jouleswarm", on_error="return"))
        yield client


def check_versions(found: dict[str, str | BaseException]) -> None:
    """Hold what workers said that their version is against this one.

    Raises:
        ConfigurationError: one has another, or none.
    """
    ours = version("jouleswarm")
    others = {worker: told for worker, told in found.items() if told != ours}
    if others:
        worker, told = min(others.items())
        what = f"version {told} of JouleSwarm" if isinstance(told, str) else f"no JouleSwarm ({told!r})"
        more = f", and {len(others) - 1} more workers another than this" if len(others) > 1 else ""
        raise ConfigurationError(
            f"worker {worker} has {what}, this is version {ours}{more}; install {ours} in the environment that "
            "`dask worker` runs in"
        )


def check_shared(client: Client, folder: Path) -> None:
    """Whether every worker can write to what is this folder here: states, logs and the scenario are in it.

    Raises:
        ConfigurationError: one cannot.
    """
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".shared-") as file:  # no other folder has one by this name
        seen = client.run(os.access, str(folder.resolve() / Path(file.name).name), os.W_OK)
    blind = sorted(worker for worker, can in seen.items() if not can)
    if blind:
        raise ConfigurationError(
            f"worker {blind[0]} does not see {folder.resolve()}, or may not write there ({len(blind)} of {len(seen)} "
            "workers); robots go on from what they keep in the run directory, so name with --out a folder that this "
            "machine and all workers share, by the same path"
        )


def address_for(workers: list[str], reached_from: Callable[[str], str] = get_ip) -> str:
    """The address of this machine that all workers reach, by the routes from here to them.

    Args:
        workers: addresses such as tcp://10.0.0.7:40001.
        reached_from: a worker's host -> the address of this machine on the way there.

    Raises:
        ConfigurationError: it is not the same for all.
    """
    found = sorted({reached_from(urlsplit(worker).hostname or "") for worker in workers})
    if len(found) > 1:
        raise ConfigurationError(
            f"workers are reached from several addresses of this machine ({', '.join(found)}); say with "
            "--listen HOST:0 which one all of them are to reach the broker by"
        )
    return found[0]


def check_protected(host: str, *, with_keys: bool, is_asked_for: bool) -> None:
    """Whether a broker may listen on this address: not by itself for everybody who reaches it.

    Raises:
        ConfigurationError: it is neither protected, nor this machine's alone, nor asked for.
    """
    if not (with_keys or is_asked_for or ipaddress.ip_address(host).is_loopback):
        raise ConfigurationError(
            f"workers are on other machines, so that the broker must listen on {host}, where anybody could read and "
            f"publish: give --keys FOLDER (`jouleswarm keys init SCENARIO --hosts {host}`), or, on a network that is "
            f"yours alone, --listen {host}:0"
        )
