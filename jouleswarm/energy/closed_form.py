"""The counts that eqs. (9) and (11) assume, from round numbers alone. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from jouleswarm.energy.facts import Counts, StageCounts


@dataclass(frozen=True)
class RoundSizes:
    """What one round computes and moves for each robot."""

    support_batches: int  # B^(a)
    query_batches: int  # B^(b)
    robot_batches: int  # B_i
    experience_bytes: float  # b(E_ik)
    weights_bytes: float  # b(W)
    first_weights_bytes: float | None = None  # of an arm's first round, where a codec needs a base; None: as all others
    batches_of: Mapping[int, int] = field(default_factory=dict)  # robot -> B_ik, where they may differ
    experience_of: Mapping[int, float] = field(default_factory=dict)  # robot -> b(E_ik), likewise
    meta_model_of: Mapping[str, float] = field(default_factory=dict)  # method -> what goes down after it; none: b(W)

    def batches(self, robots: Iterable[int]) -> float:
        """Sum over robots k of B_ik."""
        return sum(self.batches_of.get(agent, self.robot_batches) for agent in robots)

    def experience(self, robots: Iterable[int]) -> float:
        """Sum over robots k of b(E_ik)."""
        return sum(self.experience_of.get(agent, self.experience_bytes) for agent in robots)

    @property
    def base_bytes(self) -> float:
        """What an arm's first weights message has more than the others."""
        return 0.0 if self.first_weights_bytes is None else self.first_weights_bytes - self.weights_bytes


TABLE_I = RoundSizes(
    support_batches=10, query_batches=10, robot_batches=20, experience_bytes=24.6e6, weights_bytes=5.6e6
)


@dataclass(frozen=True)
class ClusterRounds:
    """A cluster that learned its task in `rounds` = t_i rounds; `links` are directed neighbour links."""

    rounds: float
    robots: int = 2
    links: int = 2
    batches: float | None = None
    """Of a round, sum over its robots k of B_ik; None: the same B_i for each."""


def closed_form(
    t0: float,
    training_robots: int,
    clusters: Iterable[ClusterRounds],
    sizes: RoundSizes = TABLE_I,
    experience_bytes: float | None = None,
    meta_model_bytes: float | None = None,
) -> StageCounts:
    """The counts that eqs. (9) and (11) assume, from round numbers alone.

    Args:
        t0: MAML rounds; 0 means no meta-model, so nothing goes down either.
        training_robots: robots that send experience, summed over the Q training tasks.
        clusters: one a task, trained or not.
        sizes: batches and bytes of a round; default the paper's Table I.
        experience_bytes: of a round, summed over the training robots; None: the same for each.
        meta_model_bytes: of the model that goes down after meta-learning; None: b(W).
    """
    clusters = list(clusters)
    robots = sum(cluster.robots for cluster in clusters)
    if experience_bytes is None:
        experience_bytes = training_robots * sizes.experience_bytes
    meta = Counts(
        gradients_support=t0 * training_robots * sizes.support_batches,
        gradients_query=t0 * training_robots * sizes.query_batches,
        uplink_bytes=t0 * experience_bytes,
        downlink_bytes=robots * (meta_model_bytes or sizes.weights_bytes) if t0 > 0 else 0,
    )
    begun = [cluster for cluster in clusters if cluster.rounds and cluster.links]
    tasks = Counts(
        gradients_robots=sum(
            c.rounds * (c.robots * sizes.robot_batches if c.batches is None else c.batches) for c in clusters
        ),
        sidelink_bytes=sum(c.links * (c.rounds * sizes.weights_bytes + sizes.base_bytes) for c in begun),
        sidelink_sent_bytes=sum(c.robots * (c.rounds * sizes.weights_bytes + sizes.base_bytes) for c in begun),
    )
    return StageCounts(meta, tasks)
