"""The embedded broker as a meter of anybody's application: started, watched, and read from its counters on the disk."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.cells import Counts, Key
from jouleswarm.common.meter.counters import read_counters
from jouleswarm.common.meter.tally import RULED
from jouleswarm.fleet.launcher import Launcher

_STATE, _LINKS, _LOGS = "state", "links.toml", "logs"
_RESTARTS = 3
_EVERYWHERE = "0.0.0.0"


@dataclass(frozen=True)
class MeterBroker:
    """One that runs."""

    folder: Path
    launcher: Launcher
    url: str
    metrics: str | None

    def counts(self) -> dict[Key, Counts]:
        """What it has counted by now.

        Raises:
            RunError: that can't be read.
        """
        return read_counters(self.folder / _STATE / RULED)

    def check(self) -> None:
        """Have one that was killed go on.

        Raises:
            RunError: it ended by itself, or too often.
        """
        self.launcher.check_broker()

    def go_by(self, links: Path) -> None:
        """Rules that were read: it is to go by them."""
        _keep(self.folder, links)
        os.kill(self.launcher.pids["broker"], signal.SIGHUP)


def check_address(listen: tuple[str | None, int]) -> None:
    """
    Raises:
        ConfigurationError: it can't be listened on.
    """
    host, port = listen[0] or _EVERYWHERE, listen[1]
    try:
        socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET).close()
    except OSError as error:
        number = error.errno or 0
        why = os.strerror(number) if number > 0 else error  # below 0: of the name
        raise ConfigurationError(f"cannot listen on {host}:{port} ({why}); choose another --listen") from error


@contextlib.contextmanager
def meter_broker(
    folder: Path,
    links: Path,
    listen: tuple[str | None, int],
    options: Sequence[str],
    told: Callable[[str], None],
) -> Iterator[MeterBroker]:
    """One as long as the context lasts; what it has counted can still be read afterwards, until `forget`.

    Args:
        folder: for its log, its counters and the rules that it goes by.
        links: the file of rules, which was read.
        listen: host (None: every address) and port.
        options: what else `python -m broker` is to be started with.
        told: a line when it was killed and is started again.

    Raises:
        ConfigurationError: it can't be started so.
        RunError: it did not listen.
    """
    _keep(folder, links)
    host, port = listen
    own = ["--host", host or _EVERYWHERE, "--links", str(folder / _STATE / _LINKS), "--state", str(folder / _STATE)]
    with Launcher(folder / _LOGS, restarts=_RESTARTS, told=told) as launcher:
        ready = launcher.start_broker([*own, *options], port=port)
        for line in (folder / _LOGS / "broker.log").read_text().splitlines():
            told(line)  # that nothing protects it
        yield MeterBroker(folder, launcher, ready["url"], ready["metrics"])


def forget(folder: Path) -> None:
    """What it kept to go on from."""
    shutil.rmtree(folder / _STATE, ignore_errors=True)


def _keep(folder: Path, links: Path) -> None:
    # A copy: the user's may be one that can't be by the time that the broker reads it.
    (folder / _STATE).mkdir(parents=True, exist_ok=True)
    write_whole(folder / _STATE / _LINKS, links.read_bytes())
