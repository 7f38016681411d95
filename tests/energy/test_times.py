"""Time to learn and waiting from facts, worked out by hand: three robots of unequal T_k on one channel or their own."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import read_links
from jouleswarm.common.scenario.robots import Robot
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.facts import STAGE, Facts, Flow, Work
from jouleswarm.energy.items import items, total
from jouleswarm.energy.literal import literal
from jouleswarm.energy.times import Seconds, times

ROUNDS = 10
ROBOTS = [Robot(id=1, tk_batch_s=0.1), Robot(id=2, tk_batch_s=0.3), Robot(id=3, tk_batch_s=0.2, sl_bit_per_s=2000)]
NAMES = ("datacenter", "agent-1", "agent-2", "agent-3")


def _energy(**more: object) -> Energy:
    return Energy.model_validate({"sl_bit_per_s": 1000, **more}).for_fleet(ROBOTS, None)


def _flow(link: Link, sender: int, receiver: int, payload: float, phase: str = "fl", task: int = 1) -> Flow:
    ends = NAMES[sender], NAMES[receiver]
    return Flow("ml" if phase == "ml" else "fl", task, link, *ends, 1, payload, payload)


def _cluster(payload: float = 1250) -> Facts:
    """Ten rounds of three robots, 5 gradients and 4 motions each; each sends 125 bytes a round to the next."""
    sides = [_flow(Link.SIDELINK, sender, receiver, payload) for sender, receiver in ((1, 2), (2, 3), (3, 1))]
    return Facts(
        arm="fl",
        method="fl",
        t0=0,
        parts={},
        rounds={1: ROUNDS},
        robots={1: 3},
        links={1: 3},
        known_flows=tuple(sides),
        known_work=tuple(Work("fl", 1, robot, 50, 0, 9.0, ROUNDS, 40) for robot in (1, 2, 3)),
        known_sent=tuple(flow._replace(receiver="") for flow in sides),
    )


def test_a_round_is_the_slowest_robot_and_one_channel_for_all() -> None:
    # Robot 2: 5 x 0.3 + 4 x 0.5 = 3.5 s a round. Sent: 1000 bit / 1000, the same, / 2000 = 1 + 1 + 0.5 s.
    found = times(_cluster(), _energy(motion_s=0.5)).tasks[1]
    assert found == Seconds(ROUNDS, pytest.approx(35), pytest.approx(25))
    assert (found.total_s, found.round_s) == (pytest.approx(60), pytest.approx(6))


def test_with_links_of_their_own_the_slowest_link_counts() -> None:
    assert times(_cluster(), _energy(medium="own")).tasks[1] == Seconds(ROUNDS, pytest.approx(15), pytest.approx(10))


def test_via_the_base_station_a_message_takes_both_hops() -> None:
    shared = _energy(sidelink="via_base_station", ul_bit_per_s=500, dl_bit_per_s=4000)
    # Up 1000 bit / 500 = 2 s each, down 0.25 s each.
    assert times(_cluster(), shared).tasks[1].communication_s == pytest.approx(10 * 3 * 2.25)
    own = shared.model_copy(update={"medium": "own"})
    assert times(_cluster(), own).tasks[1].communication_s == pytest.approx(10 * 2.25)


def test_rates_of_a_table_and_a_relayed_path(tmp_path: Path) -> None:
    lines = "from,to,bit_per_j,bit_per_s,via\n1,2,9,1000,\n2,3,9,4000,\n3,1,,,2\n3,2,9,500,\n2,1,9,2000,\n"
    (tmp_path / "links.csv").write_text(lines)
    energy = Energy().for_fleet(ROBOTS, read_links(tmp_path / "links.csv", (1, 2, 3)))
    assert energy.tells_time
    # 1000 bit a round: 1 s, 0.25 s, and from 3 by 2 to 1 2 + 0.5 s.
    assert times(_cluster(), energy).tasks[1].communication_s == pytest.approx(10 * 3.75)
    own = energy.model_copy(update={"medium": "own"})
    assert times(_cluster(), own).tasks[1].communication_s == pytest.approx(10 * 2.5)


def test_a_data_center_in_the_rounds_is_waited_for_and_waits() -> None:
    flows = [_flow(Link.UPLINK, robot, 0, 1250) for robot in (1, 2)]  # 1 s a round each
    flows += [_flow(Link.DOWNLINK, 0, robot, 1250) for robot in (1, 2)]  # 0.5 s a round each
    work = (Work("fl", 1, 1, 50, 0, 1.0, ROUNDS), Work("fl", 1, 2, 50, 0, 1.0, ROUNDS), Work("fl", 1, 0, 20, 0, 1.0))
    facts = Facts(
        "c", "c", 0, {}, {1: ROUNDS}, {1: 2}, {1: 0}, known_flows=tuple(flows), known_work=work, known_sent=()
    )
    energy = _energy(ul_bit_per_s=1000, dl_bit_per_s=2000, t0_batch_s=0.1, idle_w=1, datacenter_idle_w=1, pue=1)
    # A round: 5 x 0.3 s of robot 2, 2 x 0.1 s of the data center, 2 s up, 1 s down: 4.7 s.
    assert times(facts, energy).tasks[1] == Seconds(ROUNDS, pytest.approx(17), pytest.approx(30))
    spent = {item.payer: item.joules for item in items(facts, energy) if item.field.startswith("waiting")}
    assert spent == pytest.approx({0: 10 * (4.7 - 0.2 - 1), 1: 10 * (4.7 - 0.5 - 1), 2: 10 * (4.7 - 1.5 - 1)})


def test_what_is_lost_is_sent_again_and_takes_longer() -> None:
    assert times(_cluster(), _energy(loss=0.5)).tasks[1].communication_s == pytest.approx(50)


def test_without_a_rate_computing_is_known_and_communication_is_not() -> None:
    energy = Energy().for_fleet(ROBOTS, None)
    found = times(_cluster(), energy).tasks[1]
    assert found == Seconds(ROUNDS, pytest.approx(15), None)
    assert found.total_s is None
    assert times(_cluster(), energy).total.communication_s is None


def test_the_stage_waits_for_the_slowest_uplink_and_then_computes() -> None:
    flows = (
        _flow(Link.UPLINK, 1, 0, 1000, "ml", 1),  # 8000 bit / 1000 = 8 s
        _flow(Link.UPLINK, 2, 0, 500, "ml", 2),  # 4 s
        *(_flow(Link.DOWNLINK, 0, robot, 250, "ml", STAGE) for robot in (1, 2, 3)),  # 2000 bit / 4000 = 0.5 s each
    )
    work = (
        Work("ml", 1, 1, 0, 0, 1.0, 2, 20),
        Work("ml", 2, 2, 0, 0, 1.0, 2, 80),
        Work("ml", 1, 0, 10, 5, 1.0, 2),
        Work("ml", 2, 0, 10, 5, 1.0, 2),
    )
    energy = _energy(ul_bit_per_s=1000, dl_bit_per_s=4000, motion_s=0.1, t0_batch_s=0.5, beta=2)
    facts = Facts("maml", "maml", 2, {}, {1: 0}, {1: 1, 2: 2}, known_flows=flows, known_work=work, known_sent=())
    # Task 1: 20 x 0.1 + 8 = 10 s, task 2: 8 + 4 = 12 s; gradients 2 x (10 + 2 x 5) x 0.5 = 20 s;
    # down one after the other to the two robots of task 2: 1 s.
    assert times(facts, energy).ml == Seconds(2, pytest.approx(28), pytest.approx(5))
    waited = total(items(facts, energy.model_copy(update={"idle_w": 1.0, "datacenter_idle_w": 10.0, "pue": 1.5}))).ml
    assert waited.waiting_robots_j == pytest.approx((33 - 10) + (33 - 12))
    assert waited.waiting_datacenter_j == pytest.approx(1.5 * 10 * (33 - 20 - 1.5))


def test_robots_that_meet_nobody_do_not_wait() -> None:
    works = tuple(
        Work("fl", 1, robot, gradients, 0, 1.0, rounds)
        for robot, gradients, rounds in ((1, 500, 100), (2, 50, 10), (3, 50, 10))
    )
    facts = Facts("isolated", "isolated", 0, {}, {1: 100}, {1: 3}, {1: 0}, None, 1.0, True, (), works, ())
    energy = _energy(idle_w=3.0)
    assert times(facts, energy).tasks[1].computing_s == pytest.approx(50)  # robot 1: 500 x 0.1, the last to stop
    assert literal.price(facts, energy).fl.waiting_j == 0


def test_who_is_done_waits_at_its_own_idle_power() -> None:
    # A round is 1.5 s of robot 2 and 2.5 s of the channel; busy are 0.5 + 1, 1.5 + 1 and 1.0 + 0.5 s.
    robots = [ROBOTS[0], ROBOTS[1], Robot(id=3, tk_batch_s=0.2, sl_bit_per_s=2000, idle_w=4.0)]
    energy = Energy(sl_bit_per_s=1000, idle_w=2.0).for_fleet(robots, None)
    spent = {item.payer: item.joules for item in items(_cluster(), energy) if item.field == "waiting_robots_j"}
    assert spent == pytest.approx({1: 2 * 10 * 2.5, 2: 2 * 10 * 1.5, 3: 4 * 10 * 2.5})


def test_without_idle_power_the_bill_has_no_waiting() -> None:
    assert literal.price(_cluster(), _energy()).both.waiting_j == 0


def test_a_robot_that_left_early_was_waited_for_in_its_own_rounds_only() -> None:
    facts = _cluster()
    work = [*(facts.known_work or ())]
    work[1] = Work("fl", 1, 2, 10, 0, 1.0, 2, 8)  # two rounds of 1.5 s, as before
    early = Facts("fl", "fl", 0, {}, facts.rounds, facts.robots, facts.links, None, 1.0, True, (), tuple(work), ())
    energy = _energy(idle_w=1.0)
    assert times(early, energy).tasks[1].computing_s == pytest.approx(15)
    spent = {item.payer: item.joules for item in items(early, energy) if item.field == "waiting_robots_j"}
    assert spent == pytest.approx({1: 10.0, 3: 5.0})


_RATE = st.floats(1.0, 1e9)


@given(
    _RATE,
    _RATE,
    st.floats(1.0, 1e3),
    st.sampled_from(["shared", "own"]),
    st.sampled_from(["direct", "via_base_station"]),
)
def test_a_faster_link_is_never_longer(ul: float, sl: float, faster: float, medium: str, sidelink: str) -> None:
    def seconds(ul: float, sl: float) -> float:
        told = {"ul_bit_per_s": ul, "sl_bit_per_s": sl, "medium": medium, "sidelink": sidelink}
        return times(_cluster(), Energy.model_validate(told)).total.total_s or 0.0

    assert seconds(ul * faster, sl) <= seconds(ul, sl)
    assert seconds(ul, sl * faster) <= seconds(ul, sl)


_WATTS = st.floats(0, 100, allow_subnormal=False)


@given(_WATTS, _WATTS, st.sampled_from(["shared", "own"]))
def test_phases_and_tasks_add_up_with_waiting_too(idle_w: float, center_w: float, medium: str) -> None:
    energy = _energy(idle_w=idle_w, datacenter_idle_w=center_w, medium=medium)
    facts = _cluster()
    whole = literal.price(facts, energy)
    apart = literal.price(facts.of_ml(), energy) + literal.price(facts.of_task(1), energy)
    assert whole.total_j == pytest.approx(apart.total_j, rel=1e-9)
    assert all(each == pytest.approx(whole.total_j, rel=1e-9) for each in whole.sums_j.values())
