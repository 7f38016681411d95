"""The price list `distance`: what a link costs and how fast it is, from how far apart its ends stand.

Log-distance path loss (Rappaport, Wireless Communications, 2002, sec. 4.9): L(d) = L(d0) + 10 n log10(d/d0) dB. Rate by
Shannon with a gap (Goldsmith, Wireless Communications, 2005, ch. 9): B log2(1 + SNR/Gamma). A sender draws its radiated
power over the amplifier's efficiency and its circuits' power while it sends, and a receiver its own (Cui, Goldsmith and
Bahai, Energy-constrained modulation optimization, IEEE TWC 4(5), 2005). Bits are those of whole MQTT packets. Whoever
receives pays for receiving, with gamma where the base station passes sidelinks on.
"""

from __future__ import annotations

import math

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Flow
from jouleswarm.energy.items import BITS_PER_BYTE, LinkModel

_NOISE_DBM_PER_HZ = -174.0  # k T at 290 K


def snr_db(energy: Energy, sender: int, receiver: int) -> float:
    """Signal over noise at the receiver, dB."""
    here = energy.distance
    far = max(math.dist(energy.place(sender), energy.place(receiver)) / here.reference_m, 1.0)
    loss_db = here.reference_loss_db + 10 * here.exponent * math.log10(far)
    noise_dbm = _NOISE_DBM_PER_HZ + 10 * math.log10(here.bandwidth_hz) + here.noise_figure_db
    return 10 * math.log10(1e3 * here.transmit_w) - loss_db - noise_dbm


def bit_per_s(energy: Energy, sender: int, receiver: int) -> float:
    """The rate of a link.

    Raises:
        ConfigurationError: an end has no position.
    """
    here = energy.distance
    efficiency = math.log1p(10 ** ((snr_db(energy, sender, receiver) - here.gap_db) / 10)) / math.log(2)
    return here.bandwidth_hz * min(efficiency, here.most_bit_per_s_per_hz)


def _seconds(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    """On the air, what is sent again because it was lost included."""
    sent = flow.packet_bytes * BITS_PER_BYTE / (1 - energy.link(sender, receiver).loss)
    return sent / bit_per_s(energy, sender, receiver)


def _send(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    here = energy.distance
    power_w = here.transmit_w / here.amplifier_efficiency + here.transmit_circuit_w
    return power_w * _seconds(energy, sender, receiver, flow)


def _receive(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    return energy.distance.receive_w * _seconds(energy, sender, receiver, flow)


distance = LinkModel("distance", "by distance", _send, _receive)
