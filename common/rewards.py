"""What a cluster knows of its own rewards, and when its task counts as learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from common.state import State


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
        """Mean reward of one robot over the last `window` rounds up to `round_`: those of them that are known.

        At the start there are fewer; later all are known, unless the robot was left out of some.
        """
        known = self._known(agent, round_)
        return sum(known) / len(known)

    def cluster_reward(self, round_: int) -> float | None:
        """R of the cluster as known to all its robots once round `round_`'s payloads are in, or None yet."""
        settled = round_ - (self._diameter - 1)
        if settled < 1:
            return None
        heard = [agent for agent in self._cluster if self._known(agent, settled)]
        return sum(self.running_reward(agent, settled) for agent in heard) / len(heard) if heard else None

    def _known(self, agent: int, round_: int) -> list[float]:
        rewards = self._rewards[agent]
        return [rewards[each] for each in range(max(1, round_ - self._window + 1), round_ + 1) if each in rewards]

    def state(self) -> State:
        """See `common.state.Stateful`."""
        return State(values={str(agent): sorted(rounds.items()) for agent, rounds in self._rewards.items()})

    def load_state(self, state: State) -> None:
        """See `common.state.Stateful`."""
        self._rewards = {int(agent): dict(rounds) for agent, rounds in state.values.items()}
