"""What a cluster knows of its own rewards, and when its task counts as learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from jouleswarm.common.disk.state import State


class RewardLedger:
    """Every robot's episode reward of every round, spread from neighbour to neighbour with the weights.

    After the payloads of round t are in, all robots know the whole cluster's rewards up to round
    t - (diameter - 1), so all take the same decision in the same round without a coordinator.
    """

    def __init__(self, cluster: Sequence[int], diameter: int, window: int, *, may_miss: bool = False) -> None:
        """
        Args:
            cluster: ids of the robots.
            diameter: hops between the two robots furthest apart.
            window: rounds that R is the mean of.
            may_miss: whether robots may be left out of rounds (federation.on_missing); R is then of those heard of.
        """
        self._may_miss = may_miss
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
        """Mean reward of one robot over the last `window` rounds up to `round_`: those of them that are known.

        At the start there are fewer; later all are known, unless the robot was left out of some.
        """
        known = self._known(agent, round_)
        return sum(known) / len(known)

    def cluster_reward(self, round_: int) -> float | None:
        """R of the cluster as known to all its robots once round `round_`'s payloads are in, or None yet.

        None too where a neighbour left out what it must know: no message can end the process.
        """
        settled = round_ - (self._diameter - 1)
        if settled < 1 or not self._knows(settled):
            return None
        heard = [agent for agent in self._cluster if self._known(agent, settled)]
        return sum(self.running_reward(agent, settled) for agent in heard) / len(heard) if heard else None

    def is_full(self, round_: int) -> bool:
        """Whether R as known in `round_` is the mean over a whole window."""
        return round_ - (self._diameter - 1) >= self._window

    def _knows(self, round_: int) -> bool:
        window = range(max(1, round_ - self._window + 1), round_ + 1)
        return self._may_miss or all(each in rounds for rounds in self._rewards.values() for each in window)

    def _known(self, agent: int, round_: int) -> list[float]:
        rewards = self._rewards[agent]
        return [rewards[each] for each in range(max(1, round_ - self._window + 1), round_ + 1) if each in rewards]

    def state(self) -> State:
        """See `common.disk.state.Stateful`."""
        return State(values={str(agent): sorted(rounds.items()) for agent, rounds in self._rewards.items()})

    def load_state(self, state: State) -> None:
        """See `common.disk.state.Stateful`."""
        self._rewards = {int(agent): dict(rounds) for agent, rounds in state.values.items()}
