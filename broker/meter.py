"""What the broker counts: every PUBLISH packet in and out, and what it refused or had to give up."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from jouleswarm.broker.by_rule import RuleMeter
from jouleswarm.broker.refusals import Refusals
from jouleswarm.common.bus.paho_client import name_of
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.cells import Cell
from jouleswarm.common.meter.counters import Counters
from jouleswarm.common.meter.meter import Direction, MeterRow, rows_of
from jouleswarm.common.meter.tally import Direction as Way
from jouleswarm.common.wire.links import link_of
from jouleswarm.common.wire.topics import ROOT, Link, arm_of, run_of

logger = logging.getLogger("broker")

FORGOTTEN = "/forgotten"  # stands for the runs that were; no run can have this name


class LinkKey(NamedTuple):
    """What the live totals are kept by."""

    run: str
    arm: str
    link: Link
    direction: Direction
    client: str


# New counters beyond this are not kept: a client that makes topics up must not fill the memory with them.
MAX_ROWS = 100_000
# Beyond this the run goes of which nothing has been counted for longest, if that is QUIET_S or more.
KEPT_ROWS = 50_000
QUIET_S = 3600.0
RUNS_MISSED = 1000


class BrokerMeter:
    """The same rows as `common.meter.meter.Meter("broker")`, and running totals that are cheap to read.

    `in` is a PUBLISH received whole from a client, `out` one written whole to a subscriber; a delivery that
    was cut off is booked as aborted, never as delivered. Clients go by their plain names. The event loop
    counts; any thread may read.
    """

    def __init__(self, *, enabled: bool = True, folder: Path | None = None, by_rule: RuleMeter | None = None) -> None:
        """`folder`: where the rows of a broker that was killed are gone on from; `by_rule`: counts whatever passes."""
        self.enabled = enabled
        self.by_rule = by_rule
        self.outlives = folder is not None
        """Whether what was counted is there after a kill -9."""
        self.changes = 0
        self.refusals = Refusals()
        self.on_failure: Callable[[RunError], None] = lambda error: None
        """Called when there is no space to count in: the broker is to end."""
        self._events: Counter[str] = Counter()
        self._unmetered: Counter[str] = Counter()
        self._rows = Counters(folder)
        self._totals: dict[LinkKey, Cell] = {}
        self._moved: dict[str, tuple[int, float]] = {}  # run -> its messages, and when they were first as many
        # By what a packet says of itself: the counters that it adds to, and how many of them are of a run. Only new
        # ones need the lock, so that counting a packet costs a lookup and a few additions.
        self._counters: dict[tuple[str, str, Direction], tuple[tuple[Cell, ...], int]] = {}
        self._lock = threading.Lock()
        for (client, topic, direction), counts in self._rows.items():
            if direction != "acked":
                total = self._total(client, topic, direction)  # type: ignore[arg-type]  # it was written as one
                total.add(counts[1], counts[2], counts[0])

    def count(self, client_id: str, topic: str, direction: Direction, payload_bytes: int, packet_bytes: int) -> None:
        """Book a PUBLISH that was received, written whole to a subscriber, or acknowledged by one."""
        if self.enabled:
            counters, changes = self._found(client_id, topic, direction)
            for cell in counters:
                cell.add(payload_bytes, packet_bytes)
            self.changes += changes

    def announce(self, client_id: str, topic: str, payload_bytes: int, packet_bytes: int) -> None:
        """A PUBLISH goes into the kernel now, and can be at its subscriber before this process can count it."""
        if self.enabled:
            for cell in self._found(client_id, topic, "out")[0]:
                cell.announce(payload_bytes, packet_bytes)

    def withdraw(self, client_id: str, topic: str) -> None:
        """The kernel did not take all that was announced."""
        if self.enabled:
            for cell in self._found(client_id, topic, "out")[0]:
                cell.withdraw()

    def repeated(self, client_id: str, topic: str, direction: Direction, payload_bytes: int, packet_bytes: int) -> None:
        """A PUBLISH that was counted had DUP."""
        if self.by_rule is not None and direction in ("in", "out"):
            with self._failing():
                self.by_rule.repeated(client_id, topic, direction, payload_bytes, packet_bytes)

    def control(self, client_id: str, direction: Way, packet_bytes: int) -> None:
        """Book a packet that is no PUBLISH, received or written whole; only rules' counters have them."""
        if self.by_rule is not None:
            self.count(client_id, "", direction, 0, packet_bytes)

    def read_rules(self) -> int:
        """Have the rules as their file is now; their number. Raises ConfigurationError, and the old ones stay."""
        assert self.by_rule is not None
        self._counters = {}  # found again as they are needed
        return self.by_rule.read_anew()

    def flush(self) -> None:
        """Have the rows on the disk, if there is a folder."""
        self._rows.flush()

    def event(self, what: str, count: int = 1) -> None:
        """Count something that is not traffic, such as a refusal."""
        with self._lock:
            self._events[what] += count
        self.changes += 1

    def refused(self, what: str, text: str) -> None:
        """Count a refusal, and keep what there is to say about it; `text` is the same each time that it happens."""
        self.refusals.add(text)
        self.event(what)

    def rows(self, run: str | None = None) -> list[MeterRow]:
        """One cumulative row for each client, topic and direction, in a stable order; of one run or of all."""
        beginning = "" if run is None else f"{ROOT}/{run}/"
        with self._lock:
            return rows_of("broker", self._rows.items(beginning))

    def totals(self) -> dict[LinkKey, tuple[int, int, int]]:
        """(messages, payload bytes, packet bytes) for each run, arm, link, direction and client."""
        with self._lock:
            return {key: total.counts for key, total in self._totals.items()}

    def unmetered(self, run: str) -> int:
        """Messages of a run that there was no room to count; of runs beyond RUNS_MISSED, together."""
        return self._unmetered[run] + self._unmetered[FORGOTTEN]

    def age(self, now_s: float) -> None:
        """Forget the rows of runs that ended long ago, where there are many; the totals go on without their names."""
        messages: Counter[str] = Counter()
        for key, total in self._totals.items():
            messages[key.run] += total.messages
        del messages[FORGOTTEN]
        for run, count in messages.items():
            if self._moved.get(run, (-1, now_s))[0] != count:
                self._moved[run] = count, now_s
        for run, (_, since_s) in sorted(self._moved.items(), key=lambda each: each[1][1]):
            if len(self._rows) <= KEPT_ROWS or now_s - since_s < QUIET_S:
                return
            self._forget(run)

    def event_counts(self) -> dict[str, int]:
        """Refusals and the like since the start."""
        with self._lock:
            return dict(self._events)

    def _found(self, client_id: str, topic: str, direction: Direction) -> tuple[tuple[Cell, ...], int]:
        return self._counters.get((client_id, topic, direction)) or self._new_counters(client_id, topic, direction)

    def _new_counters(self, client_id: str, topic: str, direction: Direction) -> tuple[tuple[Cell, ...], int]:
        if self.by_rule is None and link_of(topic) is None:
            return (), 0
        if len(self._counters) >= 2 * MAX_ROWS:
            self._counters = {}  # found again as they are needed; each incarnation of a client had its own
        own: tuple[Cell, ...] = ()
        ruled, has_row = own, False
        with self._failing():
            own = self._own_counters(name_of(client_id), topic, direction)
            ruled, has_row = self._ruled_counters(client_id, topic, direction)
        found = (*own, *ruled), len(own)
        if own or (has_row and link_of(topic) is None):  # a topic without a row must not stay in memory
            self._counters[client_id, topic, direction] = found
        return found

    @contextlib.contextmanager
    def _failing(self) -> Iterator[None]:
        """No space to count in ends the broker: raised here, it would end a client's connection, again and again."""
        try:
            yield
        except RunError as error:
            self.on_failure(error)

    def _own_counters(self, name: str, topic: str, direction: Direction) -> tuple[Cell, ...]:
        """A run's: none of what is not metered, or has no room."""
        if link_of(topic) is None:
            return ()
        if len(self._rows) >= MAX_ROWS and (name, topic, direction) not in self._rows:
            self._miss(run_of(topic))
            self.refused("unmetered", f"{MAX_ROWS} counters are kept, and all in use: a message was not counted")
            return ()
        with self._lock:
            row = self._rows.cell((name, topic, direction))
            # The totals are of traffic; what was acknowledged of it concerns only who looks for losses.
            return (row,) if direction == "acked" else (row, self._total(name, topic, direction))

    def _ruled_counters(self, client_id: str, topic: str, direction: Direction) -> tuple[tuple[Cell, ...], bool]:
        """Those of rules, and whether they have a row of their own."""
        if self.by_rule is None or direction not in ("in", "out"):
            return (), False
        return self.by_rule.cells(client_id, topic, direction)

    def _miss(self, run: str) -> None:
        known = run in self._unmetered or len(self._unmetered) < RUNS_MISSED
        self._unmetered[run if known else FORGOTTEN] += 1

    def _forget(self, run: str) -> None:
        with self._lock:
            self._rows.forget(f"{ROOT}/{run}/")
            for key in [key for key in self._totals if key.run == run]:
                into = self._totals.setdefault(LinkKey(FORGOTTEN, "", key.link, key.direction, ""), Cell())
                messages, payload_bytes, packet_bytes = self._totals.pop(key).counts
                into.add(payload_bytes, packet_bytes, messages)
            self._counters = {}  # found again as they are needed
        del self._moved[run]
        logger.info("run %s was counted long ago: its rows are forgotten", run)

    def _total(self, client: str, topic: str, direction: Direction) -> Cell:
        link = link_of(topic)
        assert link is not None  # nothing else is ever counted
        return self._totals.setdefault(LinkKey(run_of(topic), arm_of(topic), link, direction, client), Cell())


def by_link(totals: Iterable[tuple[LinkKey, tuple[int, int, int]]]) -> dict[Link, dict[str, dict[str, int]]]:
    """Totals summed over runs, arms and clients: link -> direction -> messages, payload and packet bytes."""
    sums: dict[Link, dict[str, dict[str, int]]] = {}
    for key, counts in totals:
        into = sums.setdefault(key.link, {}).setdefault(
            key.direction, {"messages": 0, "payload_bytes": 0, "packet_bytes": 0}
        )
        for name, count in zip(into, counts, strict=True):
            into[name] += count
    return sums
