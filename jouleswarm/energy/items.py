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
from jouleswarm.energy.facts import Facts, Flow, Phase, UnknownFactError, Work, number_of
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
"""Joules that one end of a link pays for a flow, from one robot (or 0) to another, before gamma."""


class LinkModel(NamedTuple):
    """A price list that has its own way to price a hop; all else is as the equations have it."""

    name: str
    label: str
    send: Hop
    receive: Hop
    others: Callable[[Facts, Energy], Iterable[Item]] = lambda facts, energy: ()
    """What a radio spends beside carrying flows."""

    def price(self, facts: Facts, energy: Energy) -> Bill:
        """The bill of an arm; `energy.beta` is a number."""
        return total([*items(facts, energy, self.send, self.receive), *self.others(facts, energy)])


def constant_hop(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    """bits / E_kh and so much a message, over 1 - p where a share p is lost and sent again until it comes."""
    link = energy.link(sender, receiver)
    assert link.bit_per_j is not None  # a relayed link has been taken apart before
    joules = flow.payload_bytes * BITS_PER_BYTE / link.bit_per_j + flow.messages * link.j_per_message
    return joules / (1 - link.loss)


def items(facts: Facts, energy: Energy, send: Hop = constant_hop, receive: Hop | None = None) -> Iterator[Item]:
    """What everybody paid; `energy.beta` is a number.

    Raises:
        UnknownFactError: only sums are known of these facts, or not who sent.
        ConfigurationError: a link carried something and is not in the user's table.
    """
    for work in facts.work:
        yield from _computed(work, energy)
    for flow in facts.flows:
        yield from _moved(flow, energy, send, receive)
    if energy.sidelink == "via_base_station":
        for flow in facts.sent:
            yield from _paid(flow, energy, (number_of(flow.sender), DATA_CENTER), send, receive)
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


def _moved(flow: Flow, energy: Energy, send: Hop, receive: Hop | None) -> Iterator[Item]:
    """What carrying one flow cost all who had part in it."""
    if not flow.sender and (receive is not None or energy.links is not None):
        raise UnknownFactError("who sent these messages is not known, nor over which link")
    sender, receiver = number_of(flow.sender), number_of(flow.receiver)
    if flow.link == Link.SIDELINK and energy.sidelink == "via_base_station":
        hops = [(DATA_CENTER, receiver)]  # the way up is paid once a message, however many neighbours get it
    elif (via := energy.link(sender, receiver).via) is not None:
        hops = [(sender, via), (via, receiver)]
    else:
        hops = [(sender, receiver)]
    for ends in hops:
        yield from _paid(flow, energy, ends, send, receive)


def _paid(flow: Flow, energy: Energy, ends: tuple[int, int], send: Hop, receive: Hop | None) -> Iterator[Item]:
    """What one hop cost its sender and its receiver; eq. (11)'s remark: E_kh = E_k0 + gamma E_0h."""
    for payer, hop in zip(ends, (send, receive), strict=True):
        if hop is not None:
            relayed = payer == DATA_CENTER and flow.link == Link.SIDELINK
            gamma = (energy.base_station_pue or energy.pue) if relayed else 1.0
            joules = gamma * hop(energy, *ends, flow)
            yield Item(flow.phase, flow.task, payer, field_of(flow.link, payer), ends, joules)


def field_of(link: Link, payer: int) -> str:
    """Of `bill.Cost`: where what somebody paid for a link is booked."""
    if link == Link.UPLINK:
        return "uplink_datacenter_j" if payer == DATA_CENTER else "uplink_j"
    if link == Link.DOWNLINK:
        return "downlink_j" if payer == DATA_CENTER else "downlink_robots_j"
    return "sidelink_datacenter_j" if payer == DATA_CENTER else "sidelink_robots_j"
