"""What is priced: what an arm of a run has computed and moved, by phase, task, robot and link. Counts, never joules."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import add
from typing import Literal, NamedTuple, TypeVar

from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.wire.topics import Link

T = TypeVar("T")
Phase = Literal["ml", "fl"]
"""ml: learning a model in the data center first, eq. (8). fl: what the tasks took, eq. (10)."""

STAGE = 0
"""In place of a task: what phase ml did for all tasks together."""

BITS_PER_BYTE = 8


@dataclass(frozen=True)
class Counts:
    """What was done: batch gradients computed and bytes moved. Counts of separate phases or tasks add up."""

    gradients_support: float = 0  # in the data center, on B^(a), and all others of first order
    gradients_query: float = 0  # in the data center, on B^(b)
    gradients_robots: float = 0
    uplink_bytes: float = 0  # delivered to the data center
    downlink_bytes: float = 0  # delivered to robots
    sidelink_bytes: float = 0  # delivered to neighbours, summed over directed links
    sidelink_sent_bytes: float = 0  # sent by robots, each message once however many neighbours it has
    motions: float = 0  # to learn from, where sums are all that is known; else 0, they are in `Facts.work`
    evaluation_motions: float = 0  # of greedy episodes, the same

    def __add__(self, other: Counts) -> Counts:
        return Counts(*map(add, vars(self).values(), vars(other).values()))  # `astuple` copies, ten times as slow


@dataclass(frozen=True)
class StageCounts:
    """The counts of an arm by phase."""

    ml: Counts = field(default_factory=Counts)
    fl: Counts = field(default_factory=Counts)

    def __add__(self, other: StageCounts) -> StageCounts:
        return StageCounts(self.ml + other.ml, self.fl + other.fl)


class Flow(NamedTuple):
    """What one sender's messages of one kind to one receiver came to, as they were delivered."""

    phase: Phase
    task: int
    """0: for all tasks."""
    link: Link
    """Uplink, downlink or sidelink; it equals these words."""
    sender: str
    """`agent-3` or `datacenter`."""
    receiver: str
    messages: float
    """No whole number in an arm that is charged for a part of a shared phase ml; nor are the bytes."""
    payload_bytes: float
    packet_bytes: float
    """With MQTT's own bytes."""


class Work(NamedTuple):
    """What one process has computed for one task."""

    phase: Phase
    task: int
    robot: int
    """0: the data center."""
    plain: float
    """Batch gradients of first order, those that were lost to faults too."""
    exact: float
    """On B^(b): through gradients, eq. (5), where the method is `exact`."""
    seconds: float
    """Wall-clock time of its rounds, waiting included."""
    rounds: float = 0
    """Rounds that it did, round 0 left out."""
    motions: float = 0
    """Of a robot, to learn from; those that were lost to faults too."""
    evaluation_motions: float = 0
    """Of its greedy episodes, a forward pass each; 0 in runs that did not count them."""


def number_of(client: str) -> int:
    """A robot's number; 0 for the data center."""
    return int(client.removeprefix("agent-")) if client.startswith("agent-") else DATA_CENTER


class UnknownFactError(JouleSwarmError):
    """A price list asked for what is not known here, say messages of a study's facts: it has no bill then."""


@dataclass(frozen=True)
class Facts:
    """What an arm of one run has done. Made once and kept; nothing in it depends on a price."""

    arm: str
    method: str
    t0: float
    """Rounds of phase ml."""
    parts: Mapping[tuple[Phase, int], Counts]
    """(phase, task) -> counts; task 0 is what phase ml did for all tasks."""
    rounds: Mapping[int, float] = field(default_factory=dict)
    """Task -> t_i."""
    robots: Mapping[int, int] = field(default_factory=dict)
    """Task -> robots of its cluster."""
    links: Mapping[int, int] = field(default_factory=dict)
    """Task -> directed links between neighbours; 0 for methods without."""
    training_robots: int | None = None
    """Robots that send experience up in phase ml; None: not known."""
    beta: float | None = 1.0
    """Cost of a gradient through a gradient over one of first order as measured; None: it was not."""
    metered: bool = True
    """Whether bytes were counted; else those of `counts` are 0 and stand for nothing."""
    known_flows: tuple[Flow, ...] | None = None
    known_work: tuple[Work, ...] | None = None
    known_sent: tuple[Flow, ...] | None = None
    exact: bool = True
    """Whether gradients on B^(b) go back through an adaptation; those of first order cost 1, whatever beta is."""

    @cached_property
    def counts(self) -> StageCounts:
        """Sums by phase; asked for at each of a thousand prices."""
        sums: dict[Phase, Counts] = {
            phase: sum((part for (each, _), part in self.parts.items() if each == phase), Counts())
            for phase in ("ml", "fl")
        }
        return StageCounts(sums["ml"], sums["fl"])

    @property
    def flows(self) -> tuple[Flow, ...]:
        """What was delivered, a flow for each phase, task, link, sender and receiver; not control and telemetry.

        Raises:
            UnknownFactError: only sums are known here.
        """
        return _known(self.known_flows, "flows")

    @property
    def work(self) -> tuple[Work, ...]:
        """What was computed, by phase, task and process.

        Raises:
            UnknownFactError: only sums are known here.
        """
        return _known(self.known_work, "work")

    @property
    def sent(self) -> tuple[Flow, ...]:
        """What robots sent over sidelinks, each message once however many neighbours got it; without a receiver.

        Raises:
            UnknownFactError: only sums are known here.
        """
        return _known(self.known_sent, "sent")

    def of_ml(self) -> Facts:
        """Phase ml alone."""
        return self._only("ml", {})

    def of_task(self, task: int) -> Facts:
        """Phase fl of one task alone."""
        return self._only("fl", {task: self.rounds[task]} if task in self.rounds else {}, task)

    def _only(self, phase: Phase, rounds: Mapping[int, float], task: int | None = None) -> Facts:
        def kept(of_phase: Phase, of_task: int) -> bool:
            return of_phase == phase and task in (None, of_task)

        flows, work, sent = self.known_flows, self.known_work, self.known_sent
        return replace(
            self,
            t0=self.t0 if phase == "ml" else 0,
            parts={key: part for key, part in self.parts.items() if kept(*key)},
            rounds=rounds,
            known_flows=None if flows is None else tuple(flow for flow in flows if kept(flow.phase, flow.task)),
            known_work=None if work is None else tuple(each for each in work if kept(each.phase, each.task)),
            known_sent=None if sent is None else tuple(flow for flow in sent if kept(flow.phase, flow.task)),
        )


def _known(held: T | None, what: str) -> T:
    if held is None:
        raise UnknownFactError(f"{what}: only sums are known of these facts")
    return held
