"""A robot's place in its cluster."""

from __future__ import annotations

from dataclasses import dataclass

import networkx as nx

from jouleswarm.common.scenario.arms import SERVED_METHODS, Method
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import integer
from jouleswarm.methods.graph import cluster_graph


@dataclass(frozen=True)
class Neighbourhood:
    """Who robot `agent` exchanges weights with."""

    agent: int
    task: int
    cluster: tuple[int, ...]
    neighbours: tuple[int, ...]
    diameter: int
    """Hops between the two robots furthest apart: how many rounds a reward needs to be known by all."""


def neighbourhood_of(scenario: Scenario, agent: int, method: Method = "fl") -> Neighbourhood:
    """Robot `agent`'s neighbourhood; the same graph is drawn by every robot of the cluster.

    An isolated robot is a cluster of its own; robots of a served cluster have no sidelinks, and the data center
    tells each what all others know.
    """
    task = scenario.task_of(agent)
    cluster = scenario.cluster(task)
    if method == "isolated":
        return Neighbourhood(agent, task, (agent,), (), 1)
    if method in SERVED_METHODS:
        return Neighbourhood(agent, task, cluster, (), 1)
    graph = cluster_graph(cluster, scenario.federation, integer(scenario.seed, "topology", task))
    diameter = max(1, nx.diameter(graph))
    return Neighbourhood(agent, task, cluster, tuple(sorted(graph.neighbors(agent))), diameter)
