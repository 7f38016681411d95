"""Equations (8)-(12) against values worked out by hand from the paper's Table I."""

from dataclasses import astuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy import literal as e
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.closed_form import ClusterRounds, closed_form
from jouleswarm.energy.facts import Counts, StageCounts
from jouleswarm.energy.published import published_bill

PAPER = Energy()
REVERSED = Energy(ul_bit_per_j=500e3, sl_bit_per_j=200e3)


def test_one_gradient_costs_power_times_batch_time() -> None:
    assert e.data_center_gradient_j(PAPER) == pytest.approx(11.8)  # 590 W x 20 ms
    assert e.robot_gradient_j(PAPER) == pytest.approx(2.04)  # 5.1 W x 400 ms


def test_one_maml_round_of_three_robots() -> None:
    counts = closed_form(1, 3, [])
    assert (counts.ml.gradients_support, counts.ml.gradients_query) == (30, 30)  # 3 robots x 10 batches
    # 1.67 x 60 gradients x 11.8 J = 1182.36 J; 3 x 24.6 MB x 8 bit / 200 kb/J = 3 x 984 J = 2952 J
    bill = e.bill(counts, PAPER)
    assert bill.ml.learning_j == pytest.approx(1182.36)
    assert bill.ml.communication_j == pytest.approx(2952.0)
    assert bill.ml.total_j == pytest.approx(4134.36)
    assert bill.fl.total_j == 0


def test_one_fl_round_of_a_pair() -> None:
    bill = e.bill(closed_form(0, 3, [ClusterRounds(1)]), PAPER)
    assert bill.fl.learning_j == pytest.approx(81.6)  # 2 robots x 20 batches x 2.04 J
    assert bill.fl.communication_j == pytest.approx(179.2)  # 2 links x 5.6 MB x 8 bit / 500 kb/J
    assert bill.total_j == pytest.approx(260.8)
    assert bill.ml.total_j == 0


def test_the_meta_model_goes_down_once_to_every_robot() -> None:
    pairs = [ClusterRounds(0)] * 6
    # 12 robots x 5.6 MB x 8 bit / 200 kb/J = 12 x 224 J
    assert e.bill(closed_form(1, 3, pairs), PAPER).ml.downlink_j == pytest.approx(2688.0)
    assert closed_form(0, 3, pairs) == StageCounts()


def test_downlink_is_priced_as_uplink_unless_given() -> None:
    down = Counts(downlink_bytes=1000)
    assert e.price(down, PAPER).downlink_j == pytest.approx(0.04)  # 8000 bit / 200 kb/J
    assert e.price(down, Energy(dl_bit_per_j=800e3)).downlink_j == pytest.approx(0.01)


def test_beta_weighs_the_query_gradients_only() -> None:
    # 1.67 x (10 + 2.5 x 10) x 11.8 J = 1.67 x 35 x 11.8
    assert e.price(Counts(10, 10), Energy(beta=2.5)).computing_datacenter_j == pytest.approx(689.71)


def test_pue_is_not_applied_to_robots() -> None:
    assert e.price(Counts(gradients_robots=40), Energy(pue=3.0)).computing_robots_j == pytest.approx(81.6)


def test_via_base_station_a_pair_pays_uplink_plus_pue_times_downlink() -> None:
    station = Energy(sidelink="via_base_station", dl_bit_per_j=400e3)
    # each of 2 messages: 44.8 Mbit / 200 kb/J = 224 J up, 1.67 x 44.8 Mbit / 400 kb/J = 187.04 J down
    counts = closed_form(0, 0, [ClusterRounds(1)])
    assert e.bill(counts, station).fl.communication_j == pytest.approx(2 * (224 + 187.04))


def test_via_base_station_a_message_goes_up_once_and_down_to_each_neighbour() -> None:
    station = Energy(sidelink="via_base_station")
    counts = closed_form(0, 0, [ClusterRounds(10, robots=4, links=12)])
    assert counts.fl.sidelink_sent_bytes == 10 * 4 * 5.6e6
    assert counts.fl.sidelink_bytes == 10 * 12 * 5.6e6
    # 40 x 224 J up, 120 x 1.67 x 224 J down
    assert e.bill(counts, station).fl.communication_j == pytest.approx(8960 + 44889.6)


def test_a_lone_robot_sends_nothing() -> None:
    counts = closed_form(0, 0, [ClusterRounds(10, robots=1, links=0)]).fl
    assert (counts.sidelink_bytes, counts.sidelink_sent_bytes, counts.gradients_robots) == (0, 0, 200)


def test_the_papers_experiment_by_the_literal_equations() -> None:
    table_ii = [6.7, 29.1, 16.5, 27.7, 32, 17.2]  # t0 = 210, sums to 129.2
    bill = e.bill(closed_form(210, 3, [ClusterRounds(t) for t in table_ii]), PAPER)
    assert bill.ml.learning_j == pytest.approx(210 * 1182.36)
    assert bill.ml.communication_j == pytest.approx(210 * 2952 + 2688)
    assert bill.fl.total_j == pytest.approx(129.2 * 260.8)
    assert bill.total_j == pytest.approx(868_215.6 + 2688 + 33_695.36)


def test_reversed_efficiencies() -> None:
    bill = e.bill(closed_form(1, 3, [ClusterRounds(1)]), REVERSED)
    # up 3 x 393.6 J, down 2 x 89.6 J; sidelink 2 x 44.8 Mbit / 200 kb/J
    assert bill.ml.communication_j == pytest.approx(1180.8 + 179.2)
    assert bill.fl.communication_j == pytest.approx(448.0)


def test_published_prices_a_round() -> None:
    bill = published_bill(210, 129.2, PAPER)
    assert bill is not None
    assert bill.ml.total_j == pytest.approx(74_004.0)
    assert bill.fl.total_j == pytest.approx(31_821.96)
    assert bill.total_j == pytest.approx(105_825.96)


@pytest.mark.parametrize("elsewhere", [REVERSED, Energy(ul_bit_per_j=201e3), Energy(sidelink="via_base_station")])
def test_published_is_not_defined_elsewhere(elsewhere: Energy) -> None:
    assert published_bill(210, 129.2, elsewhere) is None


def test_each_cause_is_paid_at_one_site() -> None:
    counts = Counts(
        gradients_support=10, gradients_robots=20, uplink_bytes=1e6, downlink_bytes=2e6, sidelink_bytes=5e6,
        sidelink_sent_bytes=5e6,
    )  # fmt: skip
    cost = e.price(counts, PAPER)
    assert cost.computing_datacenter_j == pytest.approx(197.06)  # 1.67 x 10 x 11.8 J
    assert cost.computing_robots_j == pytest.approx(40.8)  # 20 x 2.04 J
    assert (cost.uplink_j, cost.downlink_j) == (40.0, 80.0)  # 8 and 16 Mbit / 200 kb/J
    assert cost.sidelink_j == 80.0  # 40 Mbit / 500 kb/J
    assert cost.robots_j == pytest.approx(40.8 + 40 + 80)
    assert cost.datacenter_j == pytest.approx(197.06 + 80)
    assert (cost.learning_j, cost.communication_j) == (pytest.approx(237.86), 200.0)


def test_via_base_station_the_way_up_is_the_robots_and_the_way_down_the_data_centers() -> None:
    counts = Counts(sidelink_sent_bytes=1e6, sidelink_bytes=3e6)
    cost = e.price(counts, Energy(sidelink="via_base_station"))
    assert cost.robots_j == pytest.approx(40.0)  # 8 Mbit / 200 kb/J
    assert cost.datacenter_j == pytest.approx(200.4)  # 1.67 x 24 Mbit / 200 kb/J
    assert cost.sidelink_j == pytest.approx(240.4)


def test_a_bill_keeps_its_stages_apart() -> None:
    counts = StageCounts(ml=Counts(uplink_bytes=1e6), fl=Counts(uplink_bytes=3e6, gradients_robots=10))
    bill = e.bill(counts, PAPER)
    assert (bill.ml.total_j, bill.ml.communication_j, bill.ml.learning_j) == (40.0, 40.0, 0.0)
    assert (bill.fl.learning_j, bill.fl.communication_j) == (pytest.approx(20.4), 120.0)
    assert bill.both.uplink_j == 160.0
    assert bill.total_j == pytest.approx(180.4)


counts_ = st.builds(Counts, *[st.integers(0, 10**12)] * 7)
stages_ = st.builds(StageCounts, counts_, counts_)
energies = st.builds(
    Energy,
    pue=st.floats(1, 3),
    beta=st.floats(1, 5),
    ul_bit_per_j=st.floats(1e3, 1e7),
    sl_bit_per_j=st.floats(1e3, 1e7),
    dl_bit_per_j=st.none() | st.floats(1e3, 1e7),
    sidelink=st.sampled_from(["direct", "via_base_station"]),
)


def joules(bill: Bill) -> tuple[float, ...]:
    return (*astuple(bill.ml), *astuple(bill.fl))


@given(stages_, stages_, energies)
def test_the_bill_of_a_sum_is_the_sum_of_the_bills(a: StageCounts, b: StageCounts, energy: Energy) -> None:
    assert joules(e.bill(a + b, energy)) == pytest.approx(joules(e.bill(a, energy) + e.bill(b, energy)))


@given(counts_, st.integers(0, 1000), energies)
def test_a_price_is_linear_in_the_counts_and_never_negative(counts: Counts, factor: int, energy: Energy) -> None:
    once = e.price(counts, energy)
    scaled = e.price(Counts(*(factor * value for value in astuple(counts))), energy)
    assert astuple(scaled) == pytest.approx(tuple(factor * part for part in astuple(once)))
    assert all(part >= 0 for part in astuple(once))


@given(stages_, energies)
def test_causes_sites_and_stages_each_add_up_to_the_total(counts: StageCounts, energy: Energy) -> None:
    bill = e.bill(counts, energy)
    for cost in (bill.ml, bill.fl, bill.both):
        assert cost.total_j == pytest.approx(sum(astuple(cost)))
        assert cost.total_j == pytest.approx(cost.robots_j + cost.datacenter_j)
    assert bill.total_j == pytest.approx(bill.both.total_j)
    assert bill.total_j == pytest.approx(bill.robots_j + bill.datacenter_j)
