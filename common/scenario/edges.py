"""A user's own graph of sidelinks: a file of pairs of robots, one a line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import networkx as nx

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.tables import table_text

Edges = dict[int, tuple[tuple[int, int], ...]]
"""Task -> its cluster's pairs of robots, each pair once."""

_HEADS = (("robot", "neighbour"), ("place", "neighbour"))


def read_edges(path: Path, clusters: Mapping[int, Sequence[int]]) -> Edges:
    """Pairs by the robots' numbers; under a first line `place,neighbour` by their places in the cluster, from 1, and
    then the same in each cluster. Empty lines, and what comes after a #, are left out; a pair may stand there twice.

    Raises:
        ConfigurationError: it cannot be read, names a robot that there is not, joins two clusters, or leaves a robot
            of a cluster out: what the robots know of each other's rewards goes along these links.
    """
    lines = list(_lines(path))
    by_place = bool(lines) and lines[0][1] == _HEADS[1]
    if lines and lines[0][1] in _HEADS:
        del lines[0]
    pairs: dict[int, dict[tuple[int, int], None]] = {task: {} for task in clusters}
    for number, words in lines:
        try:
            one, other = map(int, words)
        except ValueError:
            raise _wrong(path, number, words, "two whole numbers with a comma between them") from None
        for task, a, b in _joined(one, other, clusters, by_place=by_place):
            pairs[task][min(a, b), max(a, b)] = None
        if one == other or not any(_joined(one, other, clusters, by_place=by_place)):
            whose = "places, from 1, of each cluster" if by_place else "robots of one cluster"
            raise _wrong(path, number, words, f"two {whose}: {_told(clusters)}")
    for task, cluster in clusters.items():
        _check_joined(path, task, cluster, pairs[task])
    return {task: tuple(held) for task, held in pairs.items()}


def _joined(
    one: int, other: int, clusters: Mapping[int, Sequence[int]], *, by_place: bool
) -> Iterator[tuple[int, int, int]]:
    """(task, robot, robot) that a line joins; none where it does not fit every cluster that it is for."""
    if by_place:
        if min(one, other) >= 1 and max(one, other) <= min(map(len, clusters.values())):
            yield from ((task, cluster[one - 1], cluster[other - 1]) for task, cluster in clusters.items())
    else:
        yield from ((task, one, other) for task, cluster in clusters.items() if {one, other} <= set(cluster))


def _check_joined(path: Path, task: int, cluster: Sequence[int], pairs: Mapping[tuple[int, int], None]) -> None:
    graph: nx.Graph[int] = nx.Graph(list(pairs))
    graph.add_nodes_from(cluster)
    apart = sorted(sorted(part) for part in nx.connected_components(graph))
    if len(apart) > 1:
        raise ConfigurationError(
            f"federation.topology {path}: robots {apart[0]} and {apart[1]} of task {task} are not joined, expected a "
            "way from each robot of a cluster to each other one"
        )


def _lines(path: Path) -> Iterator[tuple[int, tuple[str, ...]]]:
    text = table_text(path, "federation.topology", "a list of pairs")
    for number, line in enumerate(text.splitlines(), start=1):
        if said := line.partition("#")[0].strip():
            yield number, tuple(word.strip() for word in said.split(","))


def _wrong(path: Path, number: int, words: Sequence[str], expected: str) -> ConfigurationError:
    got = ",".join(words)
    return ConfigurationError(f"federation.topology {path}, line {number}: got {got!r:.60}, expected {expected}")


def _told(clusters: Mapping[int, Sequence[int]]) -> str:
    told = [f"task {task} has {cluster[0]} to {cluster[-1]}" for task, cluster in clusters.items()]
    return "; ".join(told[:5]) + ("; ..." if len(told) > 5 else "")
