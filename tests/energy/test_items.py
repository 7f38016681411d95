"""Bills by items: constants for each robot and link, worked out by hand; with the paper's they are the paper's bill."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import LinkConstants, read_links
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.robots import Robot
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.facts import Counts, Facts, Flow, StageCounts, Work
from jouleswarm.energy.items import items, total
from jouleswarm.energy.literal import bill as by_counts
from jouleswarm.energy.literal import literal

ROBOTS = (1, 2, 3)


def _flow(link: Link, sender: int, receiver: int, payload: float, messages: float = 1) -> Flow:
    names = {0: "datacenter"}
    ends = [names.get(end, f"agent-{end}") for end in (sender, receiver)]
    return Flow("ml" if link == Link.UPLINK else "fl", 1, link, *ends, messages, payload, payload)


def _facts(flows: list[Flow], work: list[Work], sent: list[Flow] = []) -> Facts:  # noqa: B006
    return Facts("a", "fl", 1, {}, known_flows=tuple(flows), known_work=tuple(work), known_sent=tuple(sent))


def _links(tmp_path: Path, text: str) -> Energy:
    (tmp_path / "links.csv").write_text("from,to,bit_per_j,j_per_message,loss,via\n" + text)
    robots = [Robot(id=1, pk_w=10.0), Robot(id=2, pk_w=4.0, tk_batch_s=0.5), Robot(id=3)]
    return Energy(pue=2.0).for_fleet(robots, read_links(tmp_path / "links.csv", ROBOTS))


def test_three_robots_three_links_unequal_power_and_a_relayed_path(tmp_path: Path) -> None:
    energy = _links(
        tmp_path, "1,2,1000,,,\n2,1,4000,0.5,,\n3,datacenter,500,,0.5,\ndatacenter,1,200,,,\n3,1,,,,datacenter\n"
    )
    flows = [
        _flow(Link.SIDELINK, 1, 2, 125),  # 1000 bit / 1000 = 1 J, paid by 1
        _flow(Link.SIDELINK, 2, 1, 500, 3),  # 4000 bit / 4000 + 3 x 0.5 = 2.5 J, paid by 2
        _flow(Link.SIDELINK, 3, 1, 25),  # up 200 bit / 500 / (1 - 0.5) = 0.8 J by 3; down 2 x 200 / 200 = 2 J
        _flow(Link.UPLINK, 3, 0, 250),  # 2000 bit / 500 / (1 - 0.5) = 8 J, paid by 3
    ]
    work = [Work("fl", 1, robot, 10, 0, 0.0) for robot in ROBOTS]  # x 10 W 0.4 s, 4 W 0.5 s, 5.1 W 0.4 s
    found = list(items(_facts(flows, work), energy))
    paid = {payer: sum(item.joules for item in found if item.payer == payer) for payer in (0, *ROBOTS)}
    assert paid == pytest.approx({0: 2.0, 1: 40 + 1, 2: 20 + 2.5, 3: 20.4 + 0.8 + 8})
    bill = literal.price(_facts(flows, work), energy)
    assert bill == total(found)
    assert (bill.ml.uplink_j, bill.fl.sidelink_datacenter_j) == (pytest.approx(8), pytest.approx(2))
    assert bill.fl.sidelink_robots_j == pytest.approx(1 + 2.5 + 0.8)


def test_the_base_station_has_a_gamma_of_its_own_and_a_message_goes_up_once() -> None:
    energy = Energy(
        ul_bit_per_j=1000, dl_bit_per_j=500, pue=2, base_station_pue=3, sidelink="via_base_station", motion_j=0.5
    )
    sides = [_flow(Link.SIDELINK, 1, 2, 125), _flow(Link.SIDELINK, 1, 3, 125)]
    bill = literal.price(_facts(sides, [], [_flow(Link.SIDELINK, 1, 2, 125)._replace(receiver="")]), energy)
    assert bill.fl.sidelink_robots_j == pytest.approx(1)  # 1000 bit up, once
    assert bill.fl.sidelink_datacenter_j == pytest.approx(2 * 3 * 2)  # 1000 bit / 500 down to each, times gamma


def test_acting_and_evaluating_are_lines_of_their_own() -> None:
    energy = Energy(motion_j=10, forward_j=0.25).for_fleet([Robot(id=2, motion_j=1)], None)
    work = [Work("fl", 1, robot, 0, 0, 0.0, 2, 40, 8) for robot in (1, 2)]
    bill = literal.price(_facts([], work), energy)
    assert bill.fl.acting_robots_j == pytest.approx(400 + 40)
    assert bill.fl.evaluating_robots_j == pytest.approx(8 * 10.25 + 8 * 1.25)
    assert bill.total_j == pytest.approx(440 + 92)


def test_a_robot_has_its_own_constants_before_those_of_its_kind() -> None:
    changes: list[tuple[str, object]] = [
        ("energy.kinds", {"jetson": {"pk_w": 9.0, "ul_bit_per_j": 1e5, "g_per_kwh": 50}}),
        ("robots", [{"id": 2, "kind": "jetson", "pk_w": 8.0}, {"id": 3, "kind": "jetson"}]),
    ]
    energy = load_scenario("toy", changes).energy
    assert [energy.of(robot).pk_w for robot in (1, 2, 3)] == [5.1, 8.0, 9.0]
    assert [energy.link(robot, 0).bit_per_j for robot in (1, 2)] == [200e3, 1e5]
    assert energy.of(3).robots_g_per_kwh == 50


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1,2,0,,,\n", "line 2: bit_per_j: Input should be greater than or equal to 0.000001, got '0'"),
        ("1,2,-5,,,\n", "line 2: bit_per_j: Input should be greater"),
        ("1,2,nan,,,\n", "line 2: bit_per_j: Input should be"),
        ("1,9,100,,,\n", "line 2: robot 9 does not exist, expected one of 1 to 3"),
        ("1,2,100,,,\n1,2,100,,,\n", "line 3: 1 to 2: expected each link once"),
        ("1,2,,,,\n", "line 2: expected bit_per_j of a direct link, or via of a relayed one"),
        ("1,2,,,,3\n", "1 to 2 needs a direct link 1 to 3, expected its line"),
        ("1,2,100,,1,\n", "line 2: loss: Input should be less than or equal to 0.999, got '1'"),
    ],
)
def test_a_table_of_links_that_cannot_be_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        _links(tmp_path, text)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_link_that_carried_something_and_is_not_in_the_table_is_named(tmp_path: Path) -> None:
    energy = _links(tmp_path, "1,2,100,,,\n")
    with pytest.raises(ConfigurationError, match="no line for the link 2 to 1, which carried messages"):
        literal.price(_facts([_flow(Link.SIDELINK, 2, 1, 5)], []), energy)


_SIZES = st.integers(0, 10**9)


@given(
    st.lists(st.tuples(_SIZES, _SIZES, _SIZES, _SIZES), min_size=1, max_size=8),
    st.sampled_from(["direct", "via_base_station"]),
)
def test_with_the_papers_constants_the_items_are_the_papers_bill(
    robots: list[tuple[int, int, int, int]], sidelink: str
) -> None:
    energy = Energy.model_validate({"sidelink": sidelink, "dl_bit_per_j": 3e5, "beta": 1.5})
    flows, work, sent, counts = [], [Work("ml", 1, 0, 7, 3, 0.0)], [], Counts()
    for robot, (up, down, side, gradients) in enumerate(robots, start=1):
        flows += [_flow(Link.UPLINK, robot, 0, up)._replace(phase="fl"), _flow(Link.DOWNLINK, 0, robot, down)]
        flows += [_flow(Link.SIDELINK, robot, other, side) for other in (robot + 1, robot + 2)]
        sent.append(_flow(Link.SIDELINK, robot, robot, side)._replace(receiver=""))
        work.append(Work("fl", 1, robot, gradients, 0, 0.0))
        counts += Counts(0, 0, gradients, up, down, 2 * side, side)
    facts = _facts(flows, work, sent)
    ml = Counts(gradients_support=7, gradients_query=3)
    uniform = by_counts(StageCounts(ml, counts), energy)
    by_items = total(items(facts, energy))
    assert math.isclose(by_items.total_j, uniform.total_j, rel_tol=1e-9)
    for cause, joules in uniform.both.by_cause.items():
        assert math.isclose(by_items.both.by_cause[cause], joules, rel_tol=1e-9, abs_tol=1e-9)
    sums = [*by_items.sums_j.values(), *uniform.sums_j.values()]
    assert all(math.isclose(each, by_items.total_j, rel_tol=1e-9) for each in sums)
    assert math.isclose(sum(item.joules for item in items(facts, energy)), by_items.total_j, rel_tol=1e-9)


_SOME = st.floats(0.1, 1e3)
_OWN = st.fixed_dictionaries(
    {},
    optional=dict.fromkeys(("pk_w", "tk_batch_s", "motion_j", "ul_bit_per_j", "sl_bit_per_j", "dl_bit_per_j"), _SOME),
)


@given(st.lists(_OWN, min_size=2, max_size=6), st.lists(_SIZES, min_size=6, max_size=6), st.data())
def test_links_sites_causes_and_phases_of_any_fleet_come_to_the_total(
    own: list[dict[str, float]], sizes: list[int], data: st.DataObject
) -> None:
    robots = range(1, len(own) + 1)
    links = data.draw(
        st.none()
        | st.just(
            {
                (a, b): LinkConstants(bit_per_j=10 + a + 7 * b, j_per_message=a / 9, loss=b / 9)
                for a in (0, *robots)
                for b in (0, *robots)
                if a != b
            }
        )
    )
    sidelink = data.draw(st.sampled_from(["direct", "via_base_station"]))
    energy = Energy.model_validate({"sidelink": sidelink, "motion_j": 2, "base_station_pue": 1.3, "loss": 0.25})
    energy = energy.for_fleet(
        [Robot(id=robot, **constants) for robot, constants in zip(robots, own, strict=True)], links
    )
    flows = [_flow(Link.UPLINK, robot, 0, sizes[0]) for robot in robots]
    flows += [_flow(Link.DOWNLINK, 0, robot, sizes[1]) for robot in robots]
    flows += [_flow(Link.SIDELINK, a, b, sizes[2]) for a in robots for b in robots if a != b]
    sent = [_flow(Link.SIDELINK, robot, 0, sizes[2])._replace(receiver="") for robot in robots]
    work = [Work("fl", 1, robot, sizes[3], 0, 0.0, 1, sizes[4], sizes[5]) for robot in robots] + [
        Work("ml", 1, 0, 7, 3, 0.0)
    ]
    found = list(items(_facts(flows, work, sent), energy))
    bill = literal.price(_facts(flows, work, sent), energy)
    sums = [*bill.sums_j.values(), math.fsum(item.joules for item in found)]
    by_link: dict[tuple[int, int] | None, float] = {}
    for item in found:
        by_link[item.ends] = by_link.get(item.ends, 0.0) + item.joules
    assert all(math.isclose(each, bill.total_j, rel_tol=1e-9, abs_tol=1e-9) for each in (*sums, sum(by_link.values())))
    robots_j = math.fsum(item.joules for item in found if item.payer)
    assert math.isclose(robots_j, bill.robots_j, rel_tol=1e-9, abs_tol=1e-9)
