"""A meter for anybody's training loop: bytes, gradients, seconds and joules into a file for `jouleswarm bill`, or over
MQTT to who writes a run directory.

Nothing of our world is in it, and importing it loads no library (docs/meter_python.md).
"""

from __future__ import annotations

import atexit
import logging
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, Protocol

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.cells import Cell, Key
from jouleswarm.common.meter.counts_file import CountsFile, Rows, check_word
from jouleswarm.common.meter.joule_meter import JouleMeter
from jouleswarm.common.meter.power import NVML, Rated, gpu, processor

_FLUSH_S = 1.0
_N = 1_000_000_000
_SERVER, _CENTER = "server", "datacenter"  # as callers and as bills call it
_ROLES = {  # (link, end) -> whose meter may say so
    ("uplink", "sent"): "robot",
    ("uplink", "received"): "server",
    ("downlink", "sent"): "server",
    ("downlink", "received"): "robot",
    ("sidelink", "sent"): "robot",
    ("sidelink", "received"): "robot",
}
_Label = tuple[str, str]

log = logging.getLogger("jouleswarm.meter")


class _Out(Protocol):
    """Where rows go."""

    def put(self, rows: Rows, *, wait: bool) -> bool: ...
    def forked(self) -> None: ...
    def close(self) -> Rows: ...


class Meter:
    """Counts what one process does; any thread may count, and one opens phases.

    Counts are appended to the file when the outermost phase ends, a second after the last time at the earliest, by
    `flush`, and at exit. What is in the file a crash leaves there. Several meters may share a file. With a broker they
    are sent there in place of the file, which only gets what could not be sent by the end. A forked child counts anew
    from nothing.
    """

    def __init__(
        self,
        name: str,
        role: Literal["robot", "server"] = "robot",
        file: str | Path = "counts.csv",
        *,
        broker: str | None = None,
        arm: str = "",
        task: int | None = None,
        stage: Literal["ml", "fl"] = "fl",
        rated: Rated | None = None,
        gpu_uuid: str | None = None,
    ) -> None:
        """
        Args:
            name: of the client, as others name it in `to` and `sender`.
            role: who pays: what robots send and compute is theirs, all else the server's.
            file: CSV; what is in it stays.
            broker: URL, mqtt://[user:password@]host[:1883], behind which a meter writes down what is counted; needs
                paho-mqtt.
            arm: what the experiment compares, say "FedAvg"; the same at both ends of a link.
            task: what the client learns, where there are several.
            stage: "ml" in the data center's stage before, eq. (8); "fl", eq. (10).
            rated: of the processor, where its counter cannot be read: joules are then estimated by CPU time.
            gpu_uuid: of the GPU whose counter is read too, as PyTorch tells it.

        Raises:
            ConfigurationError: a name cannot stand in the file, the file is no meter's or cannot be written, or the URL
                is none.
        """
        if role not in ("robot", _SERVER):
            raise ConfigurationError(f"meter {name}: role {role!r}, expected 'robot' or 'server'")
        if role == "robot" and name in (_SERVER, _CENTER):
            raise ConfigurationError(f"meter {name}: a robot's name, expected another one, or role='server'")
        check_word(name)
        check_word(arm or "arm")
        self.name, self.role, self.file = name, role, Path(file).absolute()
        self._place, self._rated, self._gpu_uuid = (arm, stage, "" if task is None else str(task)), rated, gpu_uuid
        self._begin()
        self._out: _Out = CountsFile(self.file, name) if broker is None else _bus(name, broker)
        atexit.register(self.close)
        os.register_at_fork(after_in_child=self._go_on_forked)

    def _begin(self) -> None:
        self._lock, self._thread, self._depth = threading.RLock(), 0, 0
        self._label: _Label = ("", "")
        self._sums: dict[tuple[str, str, str, _Label], list[float]] = {}
        self._drawn: dict[Key, Cell] = {}
        self._flushed_s = time.monotonic()
        self._energy = JouleMeter(self._cell, processor(self._rated or Rated()), gpu(self._gpu_uuid))

    @contextmanager
    def phase(self, name: str, round: int | None = None) -> Iterator[None]:
        """What is done inside is that: its seconds, CPU seconds and joules, and what is counted meanwhile. A phase
        inside another is not part of it.

        Raises:
            ConfigurationError: another thread has a phase open, or the name cannot stand in the file.
        """
        check_word(name)
        before = self._go((name, "" if round is None else str(round)), 1)
        try:
            yield
        finally:
            self._go(before, -1)

    def gradients(self, count: int = 1) -> None:
        """Batch gradients have been computed."""
        self._count("gradients", "", "", count)

    def sent(self, link: str, nbytes: int, to: str = _SERVER) -> None:
        """A message of `nbytes` went out over "uplink", "downlink" or "sidelink"; to: a client's name.

        Raises:
            ConfigurationError: a client of this role does not send over it, or `to` is missing.
        """
        self._count(link, "sent", to, nbytes)

    def received(self, link: str, nbytes: int, sender: str = _SERVER) -> None:
        """A message of `nbytes` came in. Where both ends count, the bill takes the receiver's.

        Raises:
            ConfigurationError: a client of this role does not receive over it, or `sender` is missing.
        """
        self._count(link, "received", sender, nbytes)

    def flush(self) -> None:
        """Write what has been counted; an open phase's part too. A broker that is away is waited for some seconds; the
        counts stay then for the next time.

        Raises:
            OSError: it cannot be written; the counts stay too.
        """
        self._flush(wait=True)

    def close(self) -> None:
        """Write, and nothing more at exit. What could not be sent goes to the file, and a warning tells it.

        Raises:
            OSError: it cannot be written.
        """
        self.flush()
        atexit.unregister(self.close)
        with self._lock:
            if left := [*self._out.close(), *self._rows()]:
                CountsFile(self.file, self.name).put(left)
                log.warning("meter %s: %d rows could not be sent, they are in %s", self.name, len(left), self.file)

    def _flush(self, *, wait: bool) -> None:
        with self._lock:
            self._energy.settle()
            if self._out.put(self._rows(), wait=wait):
                self._sums, self._drawn = {}, {}
            self._flushed_s = time.monotonic()

    def _rows(self) -> Rows:
        return [*self._counted(), *self._measured()]

    def _go_on_forked(self) -> None:
        self._begin()
        self._out.forked()

    def _cell(self, key: Key) -> Cell:
        return self._drawn.setdefault(key, Cell())

    def _go(self, label: _Label, step: int) -> _Label:
        with self._lock:
            here = threading.get_ident()
            if self._depth and here != self._thread:
                raise ConfigurationError(
                    f"meter {self.name}: phase {label[0]} in a second thread, expected one thread's"
                )
            self._thread, self._depth = here, max(self._depth + step, 0)  # a fork may be inside a phase
            before, self._label = self._label, label
            self._energy.enter(*label, "")
            if not self._depth and time.monotonic() - self._flushed_s >= _FLUSH_S:
                self._flush(wait=False)
        return before

    def _count(self, what: str, end: str, other: str, amount: float) -> None:
        if amount < 0:
            raise ConfigurationError(f"meter {self.name}: {amount} of {what}, expected 0 or more")
        with self._lock:
            key = (what, end, other, self._label)
            if (held := self._sums.get(key)) is None:
                if end:
                    self._check(what, end, other)
                held = self._sums[key] = [0, 0]
            held[0] += 1
            held[1] += amount

    def _check(self, link: str, end: str, other: str) -> None:
        check_word(other)
        if _ROLES.get((link, end)) != self.role:
            ways = [each for (each, way), role in _ROLES.items() if (way, role) == (end, self.role)]
            raise ConfigurationError(f"meter {self.name}: a {self.role} has {end} {link}, expected {' or '.join(ways)}")
        if other == _SERVER and (self.role == _SERVER or link == "sidelink"):
            word = "to" if end == "sent" else "sender"
            raise ConfigurationError(f"meter {self.name}: {end} {link} without {word}=, expected a client's name")

    def _counted(self) -> Iterator[tuple[object, ...]]:
        me = self.name if self.role == "robot" else _CENTER
        for (what, end, other, (activity, round_)), (messages, amount) in self._sums.items():
            robot, to = me, ""
            if what == "sidelink":
                robot, to = (me, other) if end == "sent" else (other, me)
            elif self.role == _SERVER and end:
                robot = other
            told = {f"{what}_bytes": amount, f"{what}_messages": messages} if end else {what: amount}
            for word, value in told.items() if amount else ():
                yield (*self._place, robot, to, word, value, end, activity, round_, "")

    def _measured(self) -> Iterator[tuple[object, ...]]:
        me = self.name if self.role == "robot" else _CENTER
        for (_, where, _), cell in self._drawn.items():
            activity, round_, _, how = where.rsplit("/", 3)
            told = {"seconds": cell.messages, "cpu_s": cell.packet_bytes} if how != NVML else {}
            for what, value in (told | {"joules": cell.payload_bytes}).items():
                label = how if what == "joules" else ""
                yield (*self._place, me, "", what, f"{value / _N:.9f}", "", activity, round_, label)


def _bus(name: str, broker: str) -> _Out:
    try:
        from jouleswarm.common.meter.counts_bus import CountsBus
    except ImportError as error:
        raise ConfigurationError(f"meter {name}: broker= needs paho-mqtt: `pip install paho-mqtt`") from error
    return CountsBus(name, broker)
