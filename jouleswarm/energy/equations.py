"""The energy model, equations (8)-(12), as pure functions: counts and constants in, joules out.

`E` numbers follow the paper's numbered equations: (8)-(9) meta-learning in the data center, (10)-(11) federated
learning on the robots, (12) the total. Gradients are batch gradients, bytes are bytes, 1 kb = 1000 bit. Methods that
the paper does not have are priced cause by cause at the same constants.

Two price lists: `literal` is those equations; `published` is what the paper's printed totals come to a round,
which is not what its own equations and constants give (see `jouleswarm/report/audit.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.energy.bill import Bill as Bill
from jouleswarm.energy.bill import Cost as Cost
from jouleswarm.energy.bill import Counts as Counts
from jouleswarm.energy.bill import PublishedBill as PublishedBill
from jouleswarm.energy.bill import StageCounts as StageCounts

BITS_PER_BYTE = 8

# Section IV prints 74 kJ for 210 MAML rounds, and 227 kJ for the 921.5 FL rounds of Table II's first row.
PUBLISHED_ML_ROUND_J = 352.4
PUBLISHED_FL_ROUND_J = 246.3
PUBLISHED_UL_BIT_PER_J = 200e3
PUBLISHED_SL_BIT_PER_J = 500e3


@dataclass(frozen=True)
class RoundSizes:
    """What one round computes and moves for each robot."""

    support_batches: int  # B^(a)
    query_batches: int  # B^(b)
    robot_batches: int  # B_i
    experience_bytes: float  # b(E_ik)
    weights_bytes: float  # b(W)
    first_weights_bytes: float | None = None  # of an arm's first round, where a codec needs a base; None: as all others
    meta_model_bytes: float | None = None  # what goes down after meta-learning; None: b(W)
    batches_of: Mapping[int, int] = field(default_factory=dict)  # robot -> B_ik, where they may differ
    experience_of: Mapping[int, float] = field(default_factory=dict)  # robot -> b(E_ik), likewise

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


def data_center_gradient_j(energy: Energy) -> float:
    """Energy of one batch gradient in the data center, E_0^(C) = P_0 T_0, without PUE."""
    return energy.p0_w * energy.t0_batch_s


def robot_gradient_j(energy: Energy) -> float:
    """Energy of one batch gradient on a robot, E_k^(C) = P_k T_k."""
    return energy.pk_w * energy.tk_batch_s


def transfer_j(size_bytes: float, bit_per_j: float) -> float:
    """Energy of moving `size_bytes` over a link of efficiency `bit_per_j`."""
    return size_bytes * BITS_PER_BYTE / bit_per_j


def downlink_bit_per_j(energy: Energy) -> float:
    """E_DL; the paper gives none, so it is E_UL unless set."""
    return energy.ul_bit_per_j if energy.dl_bit_per_j is None else energy.dl_bit_per_j


def price(counts: Counts, energy: Energy) -> Cost:
    """The literal price list: what `counts` cost by cause, linear in them.

    Data center, eq. (9): gamma (support + beta query) P_0 T_0; robots, eq. (11): gradients P_k T_k; every byte at
    8 / efficiency of its link.

    Direct sidelinks: E_kh on every delivered byte. Via the base station, E_kh = E_k0 + gamma E_0h: the robot sends
    a message up once (`sidelink_sent_bytes`) and the station delivers it to each neighbour (`sidelink_bytes`). With
    one neighbour that is the paper's formula; with more it is cheaper, as a broker needs one copy only.

    Raises:
        ConfigurationError: beta is to be the measured one, which only a run's rows know.
    """
    if energy.beta == "measured":
        raise ConfigurationError('beta is "measured", expected a number by now: see jouleswarm/runs/beta.py')
    center_gradients = counts.gradients_support + energy.beta * counts.gradients_query
    down_bit_per_j = downlink_bit_per_j(energy)
    if energy.sidelink == "direct":
        side_robots_j, side_center_j = transfer_j(counts.sidelink_bytes, energy.sl_bit_per_j), 0.0
    else:
        side_robots_j = transfer_j(counts.sidelink_sent_bytes, energy.ul_bit_per_j)
        side_center_j = energy.pue * transfer_j(counts.sidelink_bytes, down_bit_per_j)
    return Cost(
        center_computing_j=energy.pue * center_gradients * data_center_gradient_j(energy),
        robot_computing_j=counts.gradients_robots * robot_gradient_j(energy),
        uplink_j=transfer_j(counts.uplink_bytes, energy.ul_bit_per_j),
        downlink_j=transfer_j(counts.downlink_bytes, down_bit_per_j),
        sidelink_robots_j=side_robots_j,
        sidelink_center_j=side_center_j,
    )


def bill(counts: StageCounts, energy: Energy) -> Bill:
    """The literal price list on both stages of an arm, eq. (12)."""
    return Bill(price(counts.ml, energy), price(counts.fl, energy))


def closed_form(
    t0: float,
    training_robots: int,
    clusters: Iterable[ClusterRounds],
    sizes: RoundSizes = TABLE_I,
    experience_bytes: float | None = None,
) -> StageCounts:
    """The counts that eqs. (9) and (11) assume, from round numbers alone.

    Args:
        t0: MAML rounds; 0 means no meta-model, so nothing goes down either.
        training_robots: robots that send experience, summed over the Q training tasks.
        clusters: one a task, trained or not.
        sizes: batches and bytes of a round; default the paper's Table I.
        experience_bytes: of a round, summed over the training robots; None: the same for each.
    """
    clusters = list(clusters)
    robots = sum(cluster.robots for cluster in clusters)
    if experience_bytes is None:
        experience_bytes = training_robots * sizes.experience_bytes
    meta = Counts(
        gradients_support=t0 * training_robots * sizes.support_batches,
        gradients_query=t0 * training_robots * sizes.query_batches,
        uplink_bytes=t0 * experience_bytes,
        downlink_bytes=robots * (sizes.meta_model_bytes or sizes.weights_bytes) if t0 > 0 else 0,
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


def published_bill(t0: float, fl_rounds: float, energy: Energy) -> PublishedBill | None:
    """The published price list: t0 x 352.4 J + sum of t_i x 246.3 J, or None where the paper implies nothing.

    It holds for the paper's deployment (3 training robots, clusters of 2) and constants, over direct sidelinks, at
    (E_UL, E_SL) = (200, 500) kb/J only; it follows neither PUE nor beta.
    """
    at = (energy.ul_bit_per_j, energy.sl_bit_per_j, energy.sidelink)
    if at != (PUBLISHED_UL_BIT_PER_J, PUBLISHED_SL_BIT_PER_J, "direct"):
        return None
    return PublishedBill(ml_j=t0 * PUBLISHED_ML_ROUND_J, fl_j=fl_rounds * PUBLISHED_FL_ROUND_J)
