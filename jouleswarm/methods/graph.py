"""Who talks to whom inside a cluster."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import networkx as nx

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Federation
from jouleswarm.common.seeding import integer

_ATTEMPTS = 100


@dataclass(frozen=True)
class Neighbourhood:
    """Who robot `agent` exchanges weights with."""

    agent: int
    task: int
    cluster: tuple[int, ...]
    neighbours: tuple[int, ...]
    diameter: int
    """Hops between the two robots furthest apart: how many rounds a reward needs to be known by all."""


def neighbourhood_of(scenario: Scenario, agent: int, partners: str = "neighbours") -> Neighbourhood:
    """Robot `agent`'s neighbourhood; the same graph is drawn by every robot of the cluster.

    A robot that meets nobody is a cluster of its own; robots that meet the data center have no sidelinks, and it tells
    each what all others know.
    """
    task = scenario.task_of(agent)
    cluster = scenario.cluster(task)
    if partners == "nobody":
        return Neighbourhood(agent, task, (agent,), (), 1)
    if partners == "datacenter":
        return Neighbourhood(agent, task, cluster, (), 1)
    graph = task_graph(scenario, task)
    diameter = max(1, nx.diameter(graph))
    return Neighbourhood(agent, task, cluster, tuple(sorted(graph.neighbors(agent))), diameter)


def directed_links(scenario: Scenario, task: int) -> int:
    """Directed neighbour links of a task's cluster, sum over k of |N_k|."""
    return 2 * task_graph(scenario, task).number_of_edges()


def directed_edges(scenario: Scenario, task: int) -> list[tuple[int, int]]:
    """Those links, (sender, receiver), in their order."""
    pairs = list(task_graph(scenario, task).edges)
    return sorted([*pairs, *((receiver, sender) for sender, receiver in pairs)])


def task_graph(scenario: Scenario, task: int) -> nx.Graph[int]:
    """The undirected graph of a task's sidelinks."""
    if scenario.edges is not None:
        graph: nx.Graph[int] = nx.Graph(scenario.edges[task])
        graph.add_nodes_from(scenario.cluster(task))
        return graph
    return cluster_graph(scenario.cluster(task), scenario.federation, integer(scenario.seed, "topology", task))


def cluster_graph(agents: Sequence[int], federation: Federation, seed: int) -> nx.Graph[int]:
    """The undirected graph of a cluster's sidelinks; each edge is two directed links.

    Raises:
        ConfigurationError: no connected graph of that degree was found.
    """
    if federation.topology == "ring":
        graph = nx.cycle_graph(len(agents)) if len(agents) > 2 else nx.complete_graph(len(agents))
    elif federation.topology == "full" or len(agents) < 2:
        graph = nx.complete_graph(len(agents))
    else:
        graph = _random_regular(len(agents), federation.degree, seed)
    relabelled: nx.Graph[int] = nx.relabel_nodes(graph, dict(enumerate(agents)))
    return relabelled


def _random_regular(size: int, degree: int, seed: int) -> nx.Graph[int]:
    for attempt in range(_ATTEMPTS):
        graph: nx.Graph[int] = nx.random_regular_graph(degree, size, seed=seed + attempt)
        if nx.is_connected(graph):
            return graph
    raise ConfigurationError(
        f"federation.degree: no connected {degree}-regular graph of {size} robots in {_ATTEMPTS} draws; "
        "use a higher degree"
    )
