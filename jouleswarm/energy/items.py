"""A bill item by item: who paid how much for what, over which link. Pure; every sum of items is a bill.

Eqs. (9) and (11) have indices: E_kh for each link, P_k and T_k for each robot. With the same constants for all robots
and links the items come to `literal.bill`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.facts import BITS_PER_BYTE as BITS_PER_BYTE
from jouleswarm.energy.facts import Facts, Flow, Phase, Work, number_of
from jouleswarm.energy.times import waits


class Item(NamedTuple):
    """Joules that one process paid."""

    phase: Phase
    task: int
    payer: int
    """A robot's number; 0: the data center or its base station."""
    field: str
    """Of `bill.Cost`."""
    ends: tuple[int, int] | None
    """Sender and receiver of the hop; None where nothing was moved."""
    joules: float


Hop = Callable[[Energy, int, int, Flow], float]
"""Joules of carrying a flow over one link, from one robot (or 0) to another, before gamma."""


def constant_hop(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    """bits / E_kh and so much a message, over 1 - p where a share p is lost and sent again until it comes."""
    link = energy.link(sender, receiver)
    assert link.bit_per_j is not None  # a relayed link has been taken apart before
    joules = flow.payload_bytes * BITS_PER_BYTE / link.bit_per_j + flow.messages * link.j_per_message
    return joules / (1 - link.loss)


def items(facts: Facts, energy: Energy, hop: Hop = constant_hop) -> Iterator[Item]:
    """What everybody paid; `energy.beta` is a number.

    Raises:
        UnknownFactError: only sums are known of these facts.
        ConfigurationError: a link carried something and is not in the user's table.
    """
    for work in facts.work:
        yield from _computed(work, energy)
    for flow in facts.flows:
        yield from _moved(flow, energy, hop)
    if energy.sidelink == "via_base_station":
        for flow in facts.sent:
            sender = number_of(flow.sender)
            joules = hop(energy, sender, DATA_CENTER, flow)
            yield Item(flow.phase, flow.task, sender, "sidelink_robots_j", (sender, DATA_CENTER), joules)
    if energy.waits_cost:
        for wait in waits(facts, energy):
            at_center = wait.who == DATA_CENTER
            watts = energy.pue * energy.datacenter_idle_w if at_center else energy.of(wait.who).idle_w
            name = "waiting_datacenter_j" if at_center else "waiting_robots_j"
            yield Item(wait.phase, wait.task, wait.who, name, None, watts * wait.seconds)


def total(found: Iterable[Item]) -> Bill:
    """The sum, by phase and cause."""
    sums: dict[str, dict[str, float]] = {"ml": {}, "fl": {}}
    for item in found:
        of_phase = sums[item.phase]
        of_phase[item.field] = of_phase.get(item.field, 0.0) + item.joules
    return Bill(Cost(**sums["ml"]), Cost(**sums["fl"]))


def _computed(work: Work, energy: Energy) -> Iterator[Item]:
    """Gradients of one process, eqs. (9) and (11), and what a robot's body did."""
    if work.robot == DATA_CENTER:
        assert energy.beta != "measured"
        gradients = work.plain + energy.beta * work.exact
        joules = energy.pue * gradients * (energy.p0_w * energy.t0_batch_s)
        yield Item(work.phase, work.task, DATA_CENTER, "computing_datacenter_j", None, joules)
        return
    here = energy.of(work.robot)
    spent = {
        "computing_robots_j": (work.plain + work.exact) * (here.pk_w * here.tk_batch_s),
        "acting_robots_j": work.motions * here.motion_j,
        "evaluating_robots_j": work.evaluation_motions * (here.motion_j + here.forward_j),
    }
    for field, joules in spent.items():
        if joules:
            yield Item(work.phase, work.task, work.robot, field, None, joules)


def _moved(flow: Flow, energy: Energy, hop: Hop) -> Iterator[Item]:
    """What carrying one flow cost its sender, and who passed it on; eq. (11)'s remark: E_kh = E_k0 + gamma E_0h."""
    sender, receiver = number_of(flow.sender), number_of(flow.receiver)

    def paid(one: int, other: int) -> Item:
        joules = hop(energy, one, other, flow)
        relayed = one == DATA_CENTER and flow.link == Link.SIDELINK
        gamma = (energy.base_station_pue or energy.pue) if relayed else 1.0
        return Item(flow.phase, flow.task, one, _field(flow.link, one), (one, other), gamma * joules)

    if flow.link == Link.SIDELINK and energy.sidelink == "via_base_station":
        yield paid(DATA_CENTER, receiver)  # the way up is paid once a message, however many neighbours get it
    elif (via := energy.link(sender, receiver).via) is not None:
        yield paid(sender, via)
        yield paid(via, receiver)
    else:
        yield paid(sender, receiver)


def _field(link: Link, payer: int) -> str:
    if link == Link.UPLINK:
        return "uplink_j"
    if link == Link.DOWNLINK:
        return "downlink_j" if payer == DATA_CENTER else "downlink_robots_j"
    return "sidelink_datacenter_j" if payer == DATA_CENTER else "sidelink_robots_j"
