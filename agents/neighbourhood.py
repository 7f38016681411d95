"""A robot's place in its cluster, and what the cluster knows of its own rewards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import networkx as nx

from common.scenario import Scenario
from common.seeding import integer
from common.topology import cluster_graph


@dataclass(frozen=True)
class Neighbourhood:
    """Who robot `agent` exchanges weights with."""

    agent: int
    task: int
    cluster: tuple[int, ...]
    neighbours: tuple[int, ...]
    diameter: int
    """Hops between the two robots furthest apart: how many rounds a reward needs to be known by all."""

    @property
    def is_lead(self) -> bool:
        """Whether this robot hands in the cluster's learned weights."""
        return self.agent == min(self.cluster)


def neighbourhood_of(scenario: Scenario, agent: int) -> Neighbourhood:
    """Robot `agent`'s neighbourhood; the same graph is drawn by every robot of the cluster."""
    task = scenario.task_of(agent)
    cluster = scenario.cluster(task)
    graph = cluster_graph(cluster, scenario.federation, integer(scenario.seed, "topology", task))
    diameter = max(1, nx.diameter(graph))
    return Neighbourhood(agent, task, cluster, tuple(sorted(graph.neighbors(agent))), diameter)


class RewardLedger:
    """Every robot's episode reward of every round, spread from neighbour to neighbour with the weights.

    After the payloads of round t are in, all robots know the whole cluster's rewards up to round
    t - (diameter - 1), so all take the same decision in the same round without a coordinator.
    """

    def __init__(self, neighbourhood: Neighbourhood, window: int) -> None:
        self._neighbourhood = neighbourhood
        self._window = window
        self._rewards: dict[int, dict[int, float]] = {agent: {} for agent in neighbourhood.cluster}

    def record(self, agent: int, round_: int, reward: float) -> None:
        """A robot's greedy episode reward in a round."""
        self._rewards[agent][round_] = reward

    def merge(self, known: Mapping[int, tuple[int, float]]) -> None:
        """What a neighbour knows; robots of other clusters are left out."""
        for agent, (round_, reward) in known.items():
            if agent in self._rewards:
                self.record(agent, round_, reward)

    def newest(self) -> dict[int, tuple[int, float]]:
        """The newest known (round, reward) of each robot, to pass on."""
        return {agent: max(rounds.items()) for agent, rounds in self._rewards.items() if rounds}

    def running_reward(self, agent: int, round_: int) -> float:
        """Mean reward of one robot over the last `window` rounds up to `round_` (fewer at the start)."""
        rounds = range(max(1, round_ - self._window + 1), round_ + 1)
        return sum(self._rewards[agent][each] for each in rounds) / len(rounds)

    def cluster_reward(self, round_: int) -> float | None:
        """R of the cluster as known to all its robots once round `round_`'s payloads are in, or None yet."""
        settled = round_ - (self._neighbourhood.diameter - 1)
        if settled < 1:
            return None
        cluster = self._neighbourhood.cluster
        return sum(self.running_reward(agent, settled) for agent in cluster) / len(cluster)
