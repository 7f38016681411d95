"""What the link models of `energy.prices` know of radios, beside the constants that all lists share."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from jouleswarm.common.scenario.bounds import BitRate, Duration, IdleWatts, Joules, Metres, Share, Watts
from jouleswarm.common.scenario.sections import Section

Place = tuple[Metres, Metres]
_Decibels = Annotated[float, Field(ge=0, le=300)]
_FrameBytes = Annotated[int, Field(ge=1, le=1_000_000)]


class Distance(Section):
    """The list `distance`. Circuits, amplifier, noise figure and exponent are those of Cui, Goldsmith and Bahai (2005);
    the rest is a 20 MHz channel at 2.4 GHz, at most 54 Mbit/s."""

    base_station_m: Place | None = Field(None, description="where it stands (x, y); the list needs it")
    row_spacing_m: Annotated[float, Field(gt=0, le=1e6)] | None = Field(
        None,
        description="robots without a position_m of their own stand in a row on the x axis, so far apart, the first at "
        "(0, 0); default: each needs its own",
    )
    transmit_w: Watts = Field(0.1, description="radiated power")
    amplifier_efficiency: Share = Field(0.35, description="of it and what the amplifier draws for it")
    transmit_circuit_w: IdleWatts = Field(0.0982, description="the rest of a sender")
    receive_w: IdleWatts = Field(0.1126, description="a receiver")
    bandwidth_hz: Annotated[float, Field(ge=1, le=1e12)] = Field(20e6, description="of the channel")
    reference_m: Annotated[float, Field(ge=1e-3, le=1e5)] = Field(1.0, description="d0; no two stand nearer")
    reference_loss_db: _Decibels = Field(40.0, description="path loss at d0: free space at 2.4 GHz")
    exponent: Annotated[float, Field(ge=1, le=10)] = Field(3.5, description="of the path loss: 10 x this dB a decade")
    noise_figure_db: _Decibels = Field(10.0, description="over -174 dBm/Hz")
    gap_db: _Decibels = Field(9.1, description="from Shannon's rate: uncoded QAM at a bit error rate of 1e-6")
    most_bit_per_s_per_hz: Annotated[float, Field(ge=1e-3, le=100)] = Field(2.7, description="of any link")


class Frames(Section):
    """The list `frames`. A Raspberry Pi at 48 Mbit/s and 15 dBm, of Serrano et al. (2015); powers are over idling."""

    j_per_frame: Joules = Field(0.126e-3, description="of sending one, whatever its size: the cross-factor")
    receive_j_per_frame: Joules | None = Field(None, description="of receiving one; default as of sending")
    transmit_w: Watts = Field(0.8066, description="while a frame is on the air")
    receive_w: Watts = Field(0.0634, description="the same of a receiver")
    bit_per_s: BitRate = Field(48e6, description="on the air, where energy tells no rate of the link")
    preamble_s: Duration = Field(20e-6, description="on the air before each frame")
    segment_bytes: _FrameBytes = Field(1448, description="TCP's MSS: 1500 less 52 of IP and TCP with timestamps")
    header_bytes: _FrameBytes = Field(88, description="a frame's own: those 52, 8 of LLC, 28 of the MAC")


class RadioStates(Section):
    """The list `radio_states`: LTE as Huang et al. (2012) measured it. A robot's round is one burst."""

    promotion_w: IdleWatts = Field(1.2107, description="while the radio wakes up")
    promotion_s: Duration = Field(0.2601, description="how long that takes")
    active_w: IdleWatts = Field(1.28804, description="while it sends or receives ...")
    ul_j_per_bit: Joules = Field(438.39e-9, description="... and for each bit sent")
    dl_j_per_bit: Joules = Field(51.97e-9, description="... or received")
    ul_bit_per_s: BitRate = Field(5.64e6, description="where energy tells none: the median")
    dl_bit_per_s: BitRate = Field(12.74e6, description="the same of receiving")
    tail_w: IdleWatts = Field(1.06, description="after the last bit of a burst")
    tail_s: Duration = Field(11.6, description="how long that lasts")
    sleep_w: IdleWatts = Field(0.02, description="from then to the next burst, where gap_s is given")
    gap_s: Duration | None = Field(
        None, description="from the end of a burst to the robot's next; default: longer than the tail"
    )
