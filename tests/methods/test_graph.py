"""Cluster graphs."""

import networkx as nx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.sections import Federation
from jouleswarm.methods.graph import cluster_graph, directed_links


def edges(agents: list[int], **federation: object) -> set[frozenset[int]]:
    graph = cluster_graph(agents, Federation.model_validate(federation), seed=1)
    assert set(graph) == set(agents)
    return {frozenset(edge) for edge in graph.edges}


def pairs(*couples: tuple[int, int]) -> set[frozenset[int]]:
    return {frozenset(couple) for couple in couples}


def test_full_links_every_pair() -> None:
    assert edges([7, 8, 9], topology="full") == pairs((7, 8), (7, 9), (8, 9))


def test_ring_links_each_to_the_next_and_the_last_to_the_first() -> None:
    assert edges([3, 4, 5, 6], topology="ring") == pairs((3, 4), (4, 5), (5, 6), (6, 3))


@pytest.mark.parametrize("topology", ["full", "ring", "random"])
def test_one_robot_has_no_neighbour_and_two_have_one_link(topology: str) -> None:
    assert edges([5], topology=topology, degree=1) == set()
    assert edges([5, 6], topology=topology, degree=1) == pairs((5, 6))


@given(st.integers(3, 9), st.integers(2, 4), st.integers(0, 2**31 - 1))
def test_random_is_regular_connected_and_the_same_for_all(size: int, degree: int, seed: int) -> None:
    if degree >= size or degree * size % 2:
        return
    federation = Federation(topology="random", degree=degree)
    graph = cluster_graph(range(1, size + 1), federation, seed)
    assert {count for _, count in graph.degree} == {degree}
    assert nx.is_connected(graph)
    assert nx.utils.graphs_equal(graph, cluster_graph(range(1, size + 1), federation, seed))


def test_other_seeds_draw_other_random_graphs() -> None:
    federation = Federation(topology="random", degree=3)
    drawn = {frozenset(map(frozenset, cluster_graph(range(8), federation, seed).edges)) for seed in range(10)}
    assert len(drawn) > 5


def test_a_degree_that_never_connects_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="no connected 1-regular graph of 4 robots"):
        cluster_graph([1, 2, 3, 4], Federation(topology="random", degree=1), seed=1)


@pytest.mark.parametrize(
    ("robots", "federation", "links"),
    [
        (1, {}, 0),
        (2, {}, 2),
        (4, {}, 12),
        (2, {"topology": "ring"}, 2),
        (3, {"topology": "ring"}, 6),
        (5, {"topology": "ring"}, 10),
        (6, {"topology": "random", "degree": 3}, 18),
        (1, {"topology": "random"}, 0),
    ],
)
def test_directed_links_of_a_cluster(robots: int, federation: dict[str, object], links: int) -> None:
    data = {
        "name": "t", "methods": ["fl"], "world": {"rows": 2, "cols": 2}, "tasks": [{"id": 1, "map": "E*\n.X"}],
        "federation": {"robots_per_cluster": robots, **federation},
    }  # fmt: skip
    assert directed_links(scenario_from(data, "test"), 1) == links
