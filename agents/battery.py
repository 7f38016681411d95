"""Whether a robot's battery lasts for another round, by its own counters and the constants of the bill."""

from __future__ import annotations

from collections.abc import Iterator

from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.battery import lives
from jouleswarm.energy.facts import Facts, Flow, Phase, Work
from jouleswarm.methods.graph import Neighbourhood

_PHASES: dict[str, Phase] = {RowPhase.ML: "ml", RowPhase.FL: "fl"}


def is_empty(scenario: Scenario, arm: Arm, here: Neighbourhood, meter: Meter, rounds: int) -> bool:
    """Whether another round of the arm would take more than is left, the rounds so far being as it.

    Each arm begins with a full battery. What the robot sends, it pays; waiting it cannot tell in advance.
    """
    if scenario.energy.of(here.agent).battery_j is None:
        return False
    shares = {"ml": arm.t0 / scenario.meta.t0 if arm.t0 else 0.0, "fl": 1.0}
    flows = tuple(_flows(arm, here, meter, shares))
    facts = Facts(
        arm=arm.name,
        method=arm.method,
        t0=0,
        parts={},
        known_flows=tuple(flow for flow in flows if flow.receiver),
        known_work=tuple(_works(arm, here, meter, rounds, shares)),
        known_sent=tuple(flow for flow in flows if not flow.receiver),
    )
    life = lives(facts, scenario.energy.model_copy(update={"beta": 1.0}))[here.agent]  # no gradients through gradients
    return life.rounds is not None and life.rounds <= rounds


def _flows(arm: Arm, here: Neighbourhood, meter: Meter, shares: dict[str, float]) -> Iterator[Flow]:
    """What the robot has sent; on sidelinks also once to each neighbour."""
    me = client_of(here.agent)
    ends = {Link.UPLINK: [client_of(DATA_CENTER)], Link.SIDELINK: [*map(client_of, here.neighbours), ""]}
    for row in meter.rows():
        if row.direction == "out" and row.link in ends and row.arm == _booked_under(arm, row.phase):
            phase = _PHASES[row.phase]
            sizes = [shares[phase] * size for size in (row.messages, row.payload_bytes, row.packet_bytes)]
            for receiver in ends[row.link]:
                yield Flow(phase, here.task, row.link, me, receiver, *sizes)


def _works(arm: Arm, here: Neighbourhood, meter: Meter, rounds: int, shares: dict[str, float]) -> Iterator[Work]:
    for row in meter.work(client_of(here.agent)):
        if row.arm == _booked_under(arm, row.phase):
            phase, share = _PHASES[row.phase], shares[_PHASES[row.phase]]
            done = rounds if phase == "fl" else 0
            did = [share * each for each in (row.gradients, row.motions, row.evaluation_motions)]
            yield Work(phase, here.task, here.agent, did[0], 0.0, 0.0, done, *did[1:])


def _booked_under(arm: Arm, phase: str) -> str:
    """A stage is its method's, whichever arms start from it."""
    return arm.name if phase == RowPhase.FL else arm.method
