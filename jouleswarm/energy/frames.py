"""The price list `frames`: a fixed energy for each frame besides its time on the air, so that many small messages cost
what they cost.

Serrano, Garcia-Saavedra, Bianchi, Banchs and Azcorra, Per-frame energy consumption in 802.11 devices and its
implication on modeling and design, IEEE/ACM ToN 23(4), 2015: P = rho_id + rho_tx tau_tx + rho_rx tau_rx + gamma_xg
lambda_g + gamma_xr lambda_r. Idling, rho_id, is left to `energy.idle_w`. MQTT packets are cut into TCP segments, each a
frame with its headers; the messages of a flow are taken as equally large. Acknowledgements, the MAC's and TCP's, are
out.
"""

from __future__ import annotations

import math

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Flow
from jouleswarm.energy.items import BITS_PER_BYTE, LinkModel


def frames_of(flow: Flow, segment_bytes: int) -> float:
    """Frames that carry a flow; no whole number where its messages are none."""
    return flow.messages * math.ceil(flow.packet_bytes / flow.messages / segment_bytes) if flow.messages else 0.0


def _joules(energy: Energy, sender: int, receiver: int, flow: Flow, power_w: float, j_per_frame: float) -> float:
    here, link = energy.frames, energy.link(sender, receiver)
    count = frames_of(flow, here.segment_bytes)
    bits = BITS_PER_BYTE * (flow.packet_bytes + count * here.header_bytes)
    seconds = bits / (link.bit_per_s or here.bit_per_s) + count * here.preamble_s
    return (count * j_per_frame + power_w * seconds) / (1 - link.loss)


def _send(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    return _joules(energy, sender, receiver, flow, energy.frames.transmit_w, energy.frames.j_per_frame)


def _receive(energy: Energy, sender: int, receiver: int, flow: Flow) -> float:
    here = energy.frames
    toll = here.j_per_frame if here.receive_j_per_frame is None else here.receive_j_per_frame
    return _joules(energy, sender, receiver, flow, here.receive_w, toll)


frames = LinkModel("frames", "by frame", _send, _receive)
