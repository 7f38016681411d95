"""Who talks to whom inside a cluster."""

from __future__ import annotations

from collections.abc import Sequence

import networkx as nx

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.sections import Federation

_ATTEMPTS = 100


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
