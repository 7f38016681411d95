"""Who a robot's neighbours are, and how a cluster decides without a coordinator."""

import networkx as nx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.methods.graph import Neighbourhood, neighbourhood_of
from jouleswarm.methods.ledger import RewardLedger

MAP = ". E . \n . * . \n . * . \n . X ."


def scenario(robots: int, **federation: object) -> Scenario:
    data = {
        "name": "t", "methods": ["fl"], "world": {"rows": 4, "cols": 3},
        "federation": {"robots_per_cluster": robots, **federation},
        "tasks": [{"id": 1, "map": MAP}, {"id": 2, "map": MAP}],
    }  # fmt: skip
    return scenario_from(data, "test")


def test_in_a_ring_of_four_each_robot_has_two_neighbours_and_two_hops_to_the_last() -> None:
    here = neighbourhood_of(scenario(4, topology="ring"), 6)
    assert here == Neighbourhood(agent=6, task=2, cluster=(5, 6, 7, 8), neighbours=(5, 7), diameter=2)


def test_a_robot_alone_has_no_neighbours() -> None:
    here = neighbourhood_of(scenario(1), 2)
    assert here == Neighbourhood(agent=2, task=2, cluster=(2,), neighbours=(), diameter=1)


def test_an_isolated_robot_is_a_cluster_of_its_own() -> None:
    here = neighbourhood_of(scenario(4), 6, "nobody")
    assert here == Neighbourhood(agent=6, task=2, cluster=(6,), neighbours=(), diameter=1)


def test_a_served_robot_has_a_cluster_but_no_sidelinks() -> None:
    here = neighbourhood_of(scenario(4, topology="ring"), 6, "datacenter")
    assert here == Neighbourhood(agent=6, task=2, cluster=(5, 6, 7, 8), neighbours=(), diameter=1)


def test_neighbours_agree_that_they_are_neighbours() -> None:
    settings = scenario(6, topology="random", degree=3)
    links = {agent: set(neighbourhood_of(settings, agent).neighbours) for agent in settings.cluster(2)}
    assert all(agent in links[other] for agent, others in links.items() for other in others)
    assert all(len(others) == 3 for others in links.values())


def test_running_reward_is_the_mean_over_the_window_and_over_fewer_rounds_at_the_start() -> None:
    ledger = RewardLedger((1,), 1, window=3)
    for round_, reward in enumerate((10.0, 20.0, 60.0, 100.0), start=1):
        ledger.record(1, round_, reward)
    assert [ledger.running_reward(1, round_) for round_ in (1, 2, 3, 4)] == [10.0, 15.0, 30.0, 60.0]


def test_the_clusters_reward_is_the_mean_over_its_robots() -> None:
    ledger = RewardLedger((1, 2), 1, window=2)
    ledger.record(1, 1, 10.0)
    ledger.merge({2: (1, 40.0)})
    assert ledger.cluster_reward(1) == 25.0
    ledger.record(1, 2, 30.0)
    ledger.merge({2: (2, 80.0)})
    assert ledger.cluster_reward(2) == 40.0  # ((10 + 30) / 2 + (40 + 80) / 2) / 2


def test_robots_of_other_clusters_are_left_out() -> None:
    ledger = RewardLedger((1, 2), 1, window=1)
    ledger.record(1, 1, 10.0)
    ledger.merge({2: (1, 20.0), 9: (1, 1e9)})
    assert ledger.newest() == {1: (1, 10.0), 2: (1, 20.0)}
    assert ledger.cluster_reward(1) == 15.0


def test_the_newest_round_is_passed_on_whatever_order_it_was_heard_in() -> None:
    ledger = RewardLedger((1, 2), 1, window=1)
    ledger.merge({2: (3, 33.0)})
    ledger.merge({2: (2, 22.0)})
    assert ledger.newest() == {2: (3, 33.0)}


def test_a_reward_that_a_neighbour_left_out_leaves_the_clusters_unknown() -> None:
    ledger = RewardLedger((1, 2), 1, window=2)
    for round_ in (1, 2, 3):
        ledger.record(1, round_, 10.0)
    ledger.merge({2: (1, 20.0)})
    ledger.merge({2: (3, 20.0)})
    assert [ledger.cluster_reward(round_) for round_ in (1, 2, 3)] == [15.0, None, None]


def test_a_ledger_keeps_no_more_rounds_than_decisions_need() -> None:
    ledger = RewardLedger((1,), 3, window=2)
    for round_ in range(1, 1001):
        ledger.record(1, round_, float(round_))
        settled = round_ - 2
        wanted = None if settled < 1 else settled - 0.5 if settled > 1 else 1.0
        assert ledger.cluster_reward(round_) == wanted
    assert len(ledger._rewards[1]) <= 5


def test_at_two_hops_the_cluster_decides_on_the_round_before() -> None:
    ledger = RewardLedger((1,), 2, window=1)
    ledger.record(1, 1, 10.0)
    assert ledger.cluster_reward(1) is None
    ledger.record(1, 2, 70.0)
    assert ledger.cluster_reward(2) == 10.0


rewards = st.floats(-100, 100)


@given(
    shape=st.sampled_from(
        [
            ("full", 1, 1),
            ("full", 3, 1),
            ("ring", 2, 1),
            ("ring", 5, 1),
            ("ring", 7, 1),
            ("random", 6, 3),
            ("random", 8, 2),
        ]
    ),
    seed=st.integers(0, 1000),
    window=st.integers(1, 4),
    data=st.data(),
)
def test_all_robots_of_a_cluster_decide_the_same_in_the_same_round(
    shape: tuple[str, int, int], seed: int, window: int, data: st.DataObject
) -> None:
    topology, robots, degree = shape
    settings = scenario(robots, topology=topology, degree=degree).model_copy(update={"seed": seed})
    cluster = settings.cluster(1)
    heres = {agent: neighbourhood_of(settings, agent) for agent in cluster}
    graph = nx.Graph([(agent, other) for agent in cluster for other in heres[agent].neighbours])
    diameter = nx.diameter(graph) if robots > 1 else 1
    assert {here.diameter for here in heres.values()} == {diameter}
    ledgers = {agent: RewardLedger(cluster, diameter, window) for agent in cluster}
    true = {agent: data.draw(st.lists(rewards, min_size=8, max_size=8)) for agent in cluster}

    for round_ in range(1, 9):
        for agent in cluster:
            ledgers[agent].record(agent, round_, true[agent][round_ - 1])
        sent = {agent: ledgers[agent].newest() for agent in cluster}
        for agent in cluster:
            for other in heres[agent].neighbours:
                ledgers[agent].merge(sent[other])
        decided = [ledgers[agent].cluster_reward(round_) for agent in cluster]
        last = round_ - (diameter - 1)
        if last < 1:
            assert decided == [None] * robots
            continue
        means = [sum(true[agent][max(0, last - window) : last]) / min(window, last) for agent in cluster]
        assert decided == pytest.approx([sum(means) / robots] * robots, abs=1e-9)
        assert len(set(decided)) == 1  # to the bit: a threshold must fall the same way for all
