"""The price list `radio_states`: a cellular radio wakes up, sends and receives, stays awake for a while, sleeps.

Huang, Qian, Gerber, Mao, Sen and Spatscheck, A close examination of performance and power characteristics of 4G LTE
networks, MobiSys 2012, Tables 3 and 4: while active P = alpha_u t_u + alpha_d t_d + beta, with a promotion before and a
tail after. Of a burst, a robot's messages in a row, there is one each round in which it sent or received, and one where
a model came down to it; control and telemetry are not seen. What the base station sends costs what `literal` has.
"""

from __future__ import annotations

from collections.abc import Iterator

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.scenario.radio import RadioStates
from jouleswarm.energy.facts import Facts, Flow, Phase, number_of
from jouleswarm.energy.items import BITS_PER_BYTE, Item, LinkModel, constant_hop, field_of


def _send(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    if sender == DATA_CENTER:
        return constant_hop(energy, sender, receiver, flow)
    here = energy.radio_states
    return _active(energy, sender, receiver, flow, here.ul_j_per_bit, here.ul_bit_per_s)


def _receive(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    if receiver == DATA_CENTER:
        return 0.0
    here = energy.radio_states
    return _active(energy, sender, receiver, flow, here.dl_j_per_bit, here.dl_bit_per_s)


def _active(energy: Energy, sender: int, receiver: int, flow: Flow, j_per_bit: float, bit_per_s: float) -> float:
    """(alpha + beta / rate) a bit; alpha is a power by rate, so an energy by bit."""
    link = energy.link(sender, receiver)
    bits = flow.packet_bytes * BITS_PER_BYTE / (1 - link.loss)
    return bits * (j_per_bit + energy.radio_states.active_w / (link.bit_per_s or bit_per_s))


def burst_j(states: RadioStates) -> float:
    """What a burst costs whatever is in it: promotion, tail, and sleep up to the next."""
    if states.gap_s is None:
        asleep_s, tail_s = 0.0, states.tail_s
    else:
        asleep_s, tail_s = max(states.gap_s - states.tail_s, 0.0), min(states.gap_s, states.tail_s)
    wakes = states.gap_s is None or asleep_s > 0  # else it is still awake when the next burst comes
    return wakes * states.promotion_w * states.promotion_s + states.tail_w * tail_s + states.sleep_w * asleep_s


def bursts(facts: Facts, energy: Energy) -> Iterator[Item]:
    """Each robot's, booked under the link that its messages went over; the uplink first, if there were several."""
    rounds = {(work.phase, work.task, work.robot): work.rounds for work in facts.work}
    found: dict[tuple[Phase, int, int], str] = {}
    for flow in sorted(facts.flows, key=lambda flow: flow.link != "uplink"):
        for robot in (number_of(flow.sender), number_of(flow.receiver)):
            if robot != DATA_CENTER:
                found.setdefault((flow.phase, flow.task, robot), field_of(flow.link, robot))
    for key, field in found.items():
        phase, task, robot = key
        yield Item(phase, task, robot, field, None, rounds.get(key, 1) * burst_j(energy.radio_states))


radio_states = LinkModel("radio_states", "by radio states (LTE)", _send, _receive, bursts)
