"""Where a deployment's processes run, on this machine or on a cluster's workers, and how they reach the broker."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.errors import ConfigurationError, usable
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.fleet.launcher import Launcher
from jouleswarm.metering.serve import parse_listen
from jouleswarm.runs.traffic import DATA_CENTER

if TYPE_CHECKING:
    from jouleswarm.fleet.remote import Remote

_LOOPBACK, _EVERYWHERE = "127.0.0.1", "0.0.0.0"
Processes = Mapping[str, tuple[str, list[str]]]
"""Process -> module and arguments."""


@dataclass(frozen=True)
class Place:
    """This machine, or a cluster."""

    listen: tuple[str | None, int] = (_LOOPBACK, 0)
    """Host (None: every address) and port (0: a free one) of the embedded broker."""
    host: str = _LOOPBACK
    """What processes call that."""
    client: Any = None
    """Of the Dask cluster; None: all on this machine."""

    def broker(self, launcher: Launcher, console: Console, options: list[str]) -> str:
        """Start the embedded broker; its URL, as processes are to know it."""
        host, port = self.listen
        ready = launcher.start_broker(["--host", host or _EVERYWHERE, *options], port)
        url = str(replace(parse_url(ready["url"]), host=self.host))
        console.print(f"broker {url}, metrics {ready['metrics']}", highlight=False)
        return url

    @contextlib.contextmanager
    def begun(
        self, run: Path, states: Path, restarts: int, told: Callable[[str], None], *, goes_on: bool
    ) -> Iterator[Remote | None]:
        """What starts processes on the cluster's workers, and ends them with the context; None on this machine."""
        if self.client is None:
            yield None
            return
        from jouleswarm.fleet.remote import Remote

        with Remote(self.client, run, states, restarts, told, goes_on=goes_on) as remote:
            yield remote


@contextlib.contextmanager
def place_of(
    scheduler: str | None, folder: Path, listen: str | None, broker: str | None, *, with_keys: bool
) -> Iterator[Place]:
    """Where a deployment goes by its options; a cluster is connected to as long as the context lasts.

    `folder`: where all its processes are to write; made on a cluster.

    Raises:
        ConfigurationError: options that do not go together; a cluster that cannot be used.
    """
    if broker is not None and listen is not None:
        raise ConfigurationError("--listen is of the embedded broker, and with --broker there is none; leave one out")
    asked, port = (None, 0) if listen is None else parse_listen(listen)
    if scheduler is None:
        yield Place((_LOOPBACK if listen is None else asked, port), asked or _LOOPBACK)
        return
    from jouleswarm.fleet import scheduler as cluster  # Dask, which takes a second to load

    with cluster.cluster_of(scheduler) as client:
        host = asked or _LOOPBACK
        if broker is None:
            host = asked or cluster.address_for(list(client.nthreads()))
            cluster.check_protected(host, with_keys=with_keys, is_asked_for=listen is not None)
        with usable("--out", folder):
            folder.mkdir(parents=True, exist_ok=True)
            cluster.check_shared(client, folder)
        yield Place((host if listen is None else asked, port), host, client)


def processes_of(scenario: Scenario, states: Path, common: list[str]) -> Processes:
    """All processes of a deployment but the broker; `common`: arguments of each."""
    found = {}
    if scenario.needs_datacenter:
        found[DATA_CENTER] = "jouleswarm.datacenter", [*common, "--state", str(states / DATA_CENTER)]
    for agent in scenario.agents:
        name = client_of(agent)
        found[name] = "jouleswarm.agents", ["--id", str(agent), *common, "--state", str(states / name)]
    return found
