"""The closed form robot by robot and link by link: what is worked out by hand, and that its sums are the counts."""

from __future__ import annotations

from dataclasses import astuple
from itertools import permutations
from typing import Any

import pytest

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.closed_form import TABLE_I, RoundSizes
from jouleswarm.energy.facts import Counts, Facts, Flow, StageCounts, Work
from jouleswarm.energy.items import items, total
from jouleswarm.energy.literal import bill
from jouleswarm.runs.arm_facts import in_closed_form
from jouleswarm.runs.sizes import expected_counts, scenario_sizes

METHODS = ("maml", "fl", "multitask", "fedavg", "centralized", "isolated")


def unequal(method: str, **changes: Any) -> Scenario:
    """Task 1: robots 1, 2, 3 in a ring of three; task 2: robots 4, 5. Robot 2 moves and learns twice as much."""
    tasks = [{"id": 1, "map": "E*\n.X", "robots": 3}, {"id": 2, "map": "E*\n.X"}]
    data = {
        "name": "x", "world": {"rows": 2, "cols": 2}, "tasks": tasks, "methods": [method],
        "robots": [{"id": 2, "motions_per_round": 40, "batches_per_round": 40}],
        "meta": {"t0": 3, "training_tasks": [1, 2], "robots_per_task": 2},
    }  # fmt: skip
    return scenario_from(data | changes, "x")


def closed(scenario: Scenario, t0: float, rounds: dict[int, float], sizes: RoundSizes | None = None) -> Facts:
    method = scenario.method_names[0]
    return in_closed_form(Facts(method, method, t0, {}), scenario, rounds, sizes or scenario_sizes(scenario))


def counted(work: tuple[Work, ...], flows: tuple[Flow, ...], sent: tuple[Flow, ...], phase: str) -> Counts:
    done = [each for each in work if each.phase == phase]
    moved = {link: sum(f.payload_bytes for f in flows if (f.link, f.phase) == (link, phase)) for link in Link}
    return Counts(
        gradients_support=sum(each.plain for each in done if not each.robot),
        gradients_query=sum(each.exact for each in done if not each.robot),
        gradients_robots=sum(each.plain + each.exact for each in done if each.robot),
        uplink_bytes=moved[Link.UPLINK],
        downlink_bytes=moved[Link.DOWNLINK],
        sidelink_bytes=moved[Link.SIDELINK],
        sidelink_sent_bytes=sum(flow.payload_bytes for flow in sent if flow.phase == phase),
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sizes", [None, TABLE_I])
def test_sums_over_robots_and_links_are_the_counts_to_the_last_bit(method: str, sizes: RoundSizes | None) -> None:
    scenario, rounds = unequal(method), {1: 4.0, 2: 7.0}
    t0 = 3.0 if scenario.meta_methods else 0.0
    found = closed(scenario, t0, rounds, sizes)
    expected = expected_counts(scenario, method, t0, rounds, sizes or scenario_sizes(scenario))
    summed = StageCounts(*(counted(found.work, found.flows, found.sent, phase) for phase in ("ml", "fl")))
    assert summed == expected == found.counts
    assert sum(astuple(expected.fl)) > 0


def test_each_robot_computes_and_moves_its_own_rounds() -> None:
    found = closed(unequal("maml"), 3, {1: 4, 2: 0})
    mine = {each.robot: each for each in found.work if each.phase == "fl"}
    assert {robot: (each.plain, each.rounds, each.motions) for robot, each in mine.items()} == {
        1: (80, 4, 80), 2: (160, 4, 160), 3: (80, 4, 80),
    }  # fmt: skip
    stage = {(each.task, each.robot): each for each in found.work if each.phase == "ml"}
    # 3 rounds x 2 robots a task x 10 batches; robot 2 collects 3 x 40 motions
    assert (stage[1, 0].plain, stage[2, 0].exact) == (60, 60)
    assert [stage[key].motions for key in ((1, 1), (1, 2), (2, 4), (2, 5))] == [60, 120, 60, 60]


def test_messages_are_those_of_the_bus() -> None:
    found = closed(unequal("maml"), 3, {1: 4, 2: 0})
    up = {f.sender: (f.messages, f.payload_bytes) for f in found.flows if f.link == Link.UPLINK}
    frame = 640 * 480 * 4
    assert up["agent-1"] == (60, 60 * frame)
    assert up["agent-2"] == (120, 120 * frame)
    down = [f for f in found.flows if f.link == Link.DOWNLINK]
    assert [(f.receiver, f.messages) for f in down] == [(f"agent-{robot}", 1) for robot in range(1, 6)]
    side = {(f.sender, f.receiver): (f.messages, f.payload_bytes) for f in found.flows if f.link == Link.SIDELINK}
    assert side == {(f"agent-{one}", f"agent-{other}"): (4, 4 * 5_565_072) for one, other in permutations((1, 2, 3), 2)}
    assert [(f.sender, f.messages, f.payload_bytes) for f in found.sent] == [
        (f"agent-{robot}", 4, 4 * 5_565_072) for robot in (1, 2, 3)
    ]


def test_the_links_are_those_of_the_graph() -> None:
    ring = unequal("fl", federation={"topology": "ring", "robots_per_cluster": 4}, tasks=[{"id": 1, "map": "E*\n.X"}])
    ends = {(flow.sender, flow.receiver) for flow in closed(ring, 0, {1: 1}).flows}
    pairs = [(1, 2), (2, 3), (3, 4), (4, 1)]
    assert ends == {(f"agent-{a}", f"agent-{b}") for one, two in pairs for a, b in ((one, two), (two, one))}


@pytest.mark.parametrize("method", METHODS)
def test_priced_item_by_item_it_is_the_paper_s_bill(method: str) -> None:
    scenario = unequal(method)
    found = closed(scenario, 3 if scenario.meta_methods else 0, {1: 4, 2: 7})
    assert total(items(found, Energy())).total_j == pytest.approx(bill(found.counts, Energy()).total_j, rel=1e-12)
