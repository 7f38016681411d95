"""What a cluster knows of its own rewards, and when its task counts as learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class RewardLedger:
    """Every robot's episode reward of every round, spread from neighbour to neighbour with the weights.

    After the payloads of round t are in, all robots know the whole cluster's rewards up to round
    t - (diameter - 1), so all take the same decision in the same round without a coordinator.
    """

    def __init__(self, cluster: Sequence[int], diameter: int, window: int) -> None:
        """`diameter`: hops between the two robots furthest apart."""
        self._cluster, self._diameter, self._window = tuple(cluster), diameter, window
        self._rewards: dict[int, dict[int, float]] = {agent: {} for agent in cluster}

    def record(self, agent: int, round_: int, reward: float) -> None:
        """A robot's greedy episode reward in a round."""
        rounds = self._rewards[agent]
        rounds[round_] = reward
        # What no decision can ask for any more: a robot's own newest round is at most a diameter ahead of that.
        for old in [each for each in rounds if each <= max(rounds) - self._window - self._diameter]:
            del rounds[old]

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
        """R of the cluster as known to all its robots once round `round_`'s payloads are in, or None yet.

        None too where a neighbour left out what it must know: no message can end the process.
        """
        settled = round_ - (self._diameter - 1)
        if settled < 1 or not self._knows(settled):
            return None
        return sum(self.running_reward(agent, settled) for agent in self._cluster) / len(self._cluster)

    def _knows(self, round_: int) -> bool:
        window = range(max(1, round_ - self._window + 1), round_ + 1)
        return all(each in rounds for rounds in self._rewards.values() for each in window)
