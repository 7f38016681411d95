"""Models of links: by distance, by frame, by the states of a radio; worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import LinkConstants
from jouleswarm.common.scenario.radio import Distance, Frames, RadioStates
from jouleswarm.common.scenario.reading import load_scenario, with_prices
from jouleswarm.common.scenario.robots import Robot
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.bill import Cost
from jouleswarm.energy.distance import bit_per_s, distance, snr_db
from jouleswarm.energy.facts import Facts, Flow, Work
from jouleswarm.energy.frames import frames
from jouleswarm.energy.items import LinkModel, items
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import own_lists, price, price_lists
from jouleswarm.energy.radio_states import burst_j, bursts, radio_states
from jouleswarm.energy.repricing import reprice

# A sender draws 0.1 / 0.5 + 0.3 = 0.5 W, a receiver 0.2 W. The noise is -174 + 60 + 14 = -100 dBm.
RADIO = Distance(
    base_station_m=(100, 0), transmit_w=0.1, amplifier_efficiency=0.5, transmit_circuit_w=0.3, receive_w=0.2,
    bandwidth_hz=1e6, reference_loss_db=40, exponent=3, noise_figure_db=14, gap_db=20,
)  # fmt: skip


def _energy(**energy: object) -> Energy:
    """Robots 1 and 2 are 200 m apart, the base station half-way; robot 3 is 10 m from it."""
    robots = [Robot(id=1, position_m=(0, 0)), Robot(id=2, position_m=(200, 0)), Robot(id=3, position_m=(110, 0))]
    return Energy.model_validate({"distance": RADIO, "pue": 2.0, **energy}).for_fleet(robots, None)


def _flow(link: Link, sender: int, receiver: int, packets: float, messages: float = 1) -> Flow:
    ends = [f"agent-{end}" if end else "datacenter" for end in (sender, receiver)]
    return Flow("ml" if link == Link.UPLINK else "fl", 1, link, *ends, messages, packets, packets)


def _facts(flows: Iterable[Flow], work: Iterable[Work] = (), sent: Iterable[Flow] = ()) -> Facts:
    return Facts("a", "fl", 0, {}, known_flows=tuple(flows), known_work=tuple(work), known_sent=tuple(sent))


def _cost(model: LinkModel, energy: Energy, *flows: Flow, sent: Iterable[Flow] = ()) -> Cost:
    bill = price(model, _facts(flows, sent=sent), energy)
    assert bill is not None
    return bill.both


def test_a_rate_follows_from_the_distance() -> None:
    energy = _energy()
    assert snr_db(energy, 1, 0) == pytest.approx(20)  # 20 dBm - 40 dB - 3 x 20 dB + 100 dBm at 100 m
    assert bit_per_s(energy, 1, 0) == pytest.approx(1e6)  # log2(1 + 20 dB - 20 dB) = 1 bit/s/Hz
    assert bit_per_s(energy, 3, 0) == pytest.approx(2.7e6)  # log2(1 + 1000) would be 10, above the most of any link
    near = energy.for_fleet([Robot(id=1, position_m=(100.001, 0))], None)
    assert snr_db(near, 1, 0) == pytest.approx(80)  # nearer than d0 is d0


def test_whoever_receives_pays_for_receiving() -> None:
    cost = _cost(distance, _energy(), _flow(Link.UPLINK, 1, 0, 125), _flow(Link.DOWNLINK, 0, 2, 250))
    assert cost.uplink_j == pytest.approx(0.5e-3)  # 1000 bit in 1 ms
    assert cost.uplink_datacenter_j == pytest.approx(0.2e-3)
    assert (cost.downlink_j, cost.downlink_robots_j) == (pytest.approx(1e-3), pytest.approx(0.4e-3))
    assert (cost.datacenter_j, cost.robots_j) == (pytest.approx(1.2e-3), pytest.approx(0.9e-3))


def test_via_the_base_station_a_message_goes_up_once_and_gamma_is_on_what_the_station_does() -> None:
    side = _flow(Link.SIDELINK, 1, 2, 125)
    cost = _cost(distance, _energy(sidelink="via_base_station"), side, sent=[side._replace(receiver="")])
    assert cost.sidelink_robots_j == pytest.approx(0.5e-3 + 0.2e-3)  # 1 sends up, 2 receives
    assert cost.sidelink_datacenter_j == pytest.approx(2 * 0.2e-3 + 2 * 0.5e-3)


def test_what_nobody_knows_who_sent_has_no_bill_by_links() -> None:
    control = _facts([_flow(Link.DOWNLINK, 0, 1, 125)._replace(sender="")])
    table = Energy(links="links.csv").for_fleet([], {(1, 2): LinkConstants(bit_per_j=1.0)})
    assert [price(each, control, _energy()) for each in (distance, frames, radio_states)] == [None] * 3
    assert price(literal, control, table) is None


def test_a_fixed_energy_a_frame_makes_small_messages_dear() -> None:
    card = Frames(
        j_per_frame=1e-3, receive_j_per_frame=0.5e-3, transmit_w=1, receive_w=0.5, bit_per_s=1e6, preamble_s=1e-3,
        segment_bytes=1000, header_bytes=50,
    )  # fmt: skip
    many = _cost(frames, Energy(frames=card), _flow(Link.DOWNLINK, 0, 1, 1000, messages=10))
    assert many.downlink_j == pytest.approx(10e-3 + 12e-3 + 10e-3)  # 10 frames, 8 x (1000 + 500) bit, preambles
    assert many.downlink_robots_j == pytest.approx(5e-3 + (12e-3 + 10e-3) / 2)
    one = _cost(frames, Energy(frames=card), _flow(Link.DOWNLINK, 0, 1, 1000))
    assert one.downlink_j == pytest.approx(1e-3 + 8.4e-3 + 1e-3)
    three = _cost(frames, Energy(frames=card), _flow(Link.DOWNLINK, 0, 1, 2500))
    assert three.downlink_j == pytest.approx(3e-3 + 21.2e-3 + 3e-3)  # 8 x (2500 + 3 x 50) bit
    assert _cost(frames, Energy(frames=card), _flow(Link.DOWNLINK, 0, 1, 0, messages=0)).total_j == 0


def test_a_tail_is_12_j_and_270_bursts_are_3_kj() -> None:
    tail = RadioStates(promotion_s=0)
    assert burst_j(tail) == pytest.approx(12.3, abs=0.01)  # 1.06 W x 11.6 s
    robots = range(1, 4)
    facts = _facts(
        [_flow(Link.UPLINK, robot, 0, 1e6, 1800) for robot in robots],
        [Work("ml", 1, robot, 0, 0, 0.0, rounds=90) for robot in robots],
    )
    found = list(bursts(facts, Energy(radio_states=tail)))
    assert {(item.payer, item.field) for item in found} == {(robot, "uplink_j") for robot in robots}
    assert sum(item.joules for item in found) == pytest.approx(3.32e3, rel=1e-3)


def test_a_radio_that_is_still_awake_needs_no_promotion() -> None:
    assert burst_j(RadioStates()) == pytest.approx(1.2107 * 0.2601 + 12.296)
    assert burst_j(RadioStates(gap_s=8)) == pytest.approx(1.06 * 8)
    assert burst_j(RadioStates(gap_s=21.6)) == pytest.approx(1.2107 * 0.2601 + 12.296 + 10 * 0.02)


def test_a_model_that_comes_down_is_a_burst_and_bits_cost_by_direction() -> None:
    burst = burst_j(RadioStates())
    cost = _cost(radio_states, Energy(dl_bit_per_j=1e6), _flow(Link.DOWNLINK, 0, 1, 125e3))
    assert cost.downlink_j == pytest.approx(1)  # 1e6 bit at the base station's E_DL
    assert cost.downlink_robots_j == pytest.approx(0.05197 + 1.28804 / 12.74 + burst)
    cost = _cost(radio_states, Energy(ul_bit_per_s=1e6), _flow(Link.UPLINK, 1, 0, 125e3))
    assert (cost.uplink_j, cost.uplink_datacenter_j) == (pytest.approx(0.43839 + 1.28804 + burst), 0)


@given(
    st.sampled_from([distance, frames, radio_states]),
    st.lists(st.integers(1, 10**7), min_size=1, max_size=4),
    st.integers(1, 50),
    st.sampled_from([0.0, 0.5]),
)
def test_joules_are_linear_in_what_is_carried(model: LinkModel, sizes: list[int], times: int, loss: float) -> None:
    energy, no_bursts = _energy(loss=loss), RadioStates(promotion_s=0, tail_s=0)
    energy = energy.model_copy(update={"radio_states": no_bursts})
    flows = [_flow(Link.SIDELINK, 1, 2, size) for size in sizes]
    one_by_one = sum(_cost(model, energy, flow).total_j for flow in flows)
    assert math.isclose(_cost(model, energy, *flows).total_j, one_by_one, rel_tol=1e-9)
    again = [flow._replace(messages=times, packet_bytes=times * flow.packet_bytes) for flow in flows]
    assert math.isclose(_cost(model, energy, *again).total_j, times * one_by_one, rel_tol=1e-9)
    lossless = _cost(model, energy.model_copy(update={"loss": 0.0}), *flows).total_j
    assert math.isclose(one_by_one, lossless / (1 - loss), rel_tol=1e-9)
    at_once = _flow(Link.SIDELINK, 1, 2, sum(sizes))
    together = _cost(model, energy, at_once).total_j
    assert together <= one_by_one * (1 + 1e-9)
    assert model is frames or math.isclose(together, one_by_one, rel_tol=1e-9)
    paid = sum(item.joules for item in items(_facts(flows), energy, model.send, model.receive))
    assert math.isclose(paid, one_by_one, rel_tol=1e-9)


HERE: list[tuple[str, object]] = [
    ("energy.prices", ["literal", "distance", "frames", "radio_states"]),
    ("energy.distance.base_station_m", [0, 80]),
    ("energy.distance.row_spacing_m", 10),
]


def test_the_lists_come_in_by_their_words_and_have_columns_of_their_own() -> None:
    scenario = load_scenario("toy", HERE)
    lists = price_lists(scenario)
    assert [each.name for each in own_lists(lists)] == ["distance", "frames", "radio_states"]
    assert (scenario.energy.place(0), scenario.energy.place(3)) == ((0, 80), (20, 0))
    other, suffix = reprice(scenario, ["energy.distance.base_station_m=[0, 40]"], "RUN")
    assert (other.energy.place(0), suffix) == ((0, 40), "-distance.base-station-m-0.0-40.0")


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("energy.distance.base_station_m", None, "expected energy.distance.base_station_m = [x, y]"),
        ("energy.distance.row_spacing_m", None, "robot 1 has no position, expected position_m in its [[robots]], or"),
        ("energy.distance.base_station_m", [30, 0], "robot 4 and the base station are both at (30, 0) m, expected two"),
        ("energy.distance.bandwidth_hz", 0, "energy.distance.bandwidth_hz: Input should be greater than or equal to 1"),
    ],
)
def test_who_stands_nowhere_or_where_another_is_is_told_in_one_line(key: str, value: object, said: str) -> None:
    changes: list[tuple[str, object]] = [*(each for each in HERE if each[0] != key), (key, value)]
    for load in (lambda: load_scenario("toy", changes), lambda: with_prices(load_scenario("toy"), changes, "RUN")):
        with pytest.raises(ConfigurationError) as error:
            load()
        assert said in str(error.value)
        assert "\n" not in str(error.value)
