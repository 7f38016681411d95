"""The energy model, equations (8)-(12), as pure functions: counts and constants in, joules out.

`E` numbers follow the paper's numbered equations: (8)-(9) meta-learning in the data center, (10)-(11) federated
learning on the robots, (12) the total. Gradients are batch gradients, bytes are bytes, 1 kb = 1000 bit.

Two price lists: `literal` is those equations; `published` is what the paper's printed totals come to a round,
which is not what its own equations and constants give (see `fleet/audit.py`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass

from common.settings import Energy, Federation

BITS_PER_BYTE = 8

# Section IV prints 74 kJ for 210 MAML rounds, and 227 kJ for the 921.5 FL rounds of Table II's first row.
PUBLISHED_ML_ROUND_J = 352.4
PUBLISHED_FL_ROUND_J = 246.3
PUBLISHED_UL_BIT_PER_J = 200e3
PUBLISHED_SL_BIT_PER_J = 500e3


@dataclass(frozen=True)
class Counts:
    """What a run did: batch gradients computed and bytes moved. Counts of separate runs or tasks add up."""

    gradients_support: float = 0  # in the data center, on B^(a)
    gradients_query: float = 0  # in the data center, on B^(b)
    gradients_robots: float = 0
    uplink_bytes: float = 0  # delivered to the data center
    downlink_bytes: float = 0  # delivered to robots
    sidelink_bytes: float = 0  # delivered to neighbours, summed over directed links
    sidelink_sent_bytes: float = 0  # sent by robots, each message once however many neighbours it has

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


@dataclass(frozen=True)
class Bill:
    """Joules by stage and cause, eq. (12)."""

    ml_learning_j: float = 0.0
    ml_communication_j: float = 0.0
    fl_learning_j: float = 0.0
    fl_communication_j: float = 0.0

    def __add__(self, other: Bill) -> Bill:
        return Bill(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    @property
    def ml_j(self) -> float:
        """E_ML, eq. (8)."""
        return self.ml_learning_j + self.ml_communication_j

    @property
    def fl_j(self) -> float:
        """Sum of E_FL over the tasks, eq. (10)."""
        return self.fl_learning_j + self.fl_communication_j

    @property
    def total_j(self) -> float:
        """E, eq. (12)."""
        return self.ml_j + self.fl_j


@dataclass(frozen=True)
class PublishedBill:
    """Joules by stage; the paper's printed totals do not tell learning from communication."""

    ml_j: float
    fl_j: float

    @property
    def total_j(self) -> float:
        """E, eq. (12)."""
        return self.ml_j + self.fl_j


@dataclass(frozen=True)
class RoundSizes:
    """What one round computes and moves for each robot."""

    support_batches: int  # B^(a)
    query_batches: int  # B^(b)
    robot_batches: int  # B_i
    experience_bytes: float  # b(E_ik)
    weights_bytes: float  # b(W)


TABLE_I = RoundSizes(
    support_batches=10, query_batches=10, robot_batches=20, experience_bytes=24.6e6, weights_bytes=5.6e6
)


@dataclass(frozen=True)
class ClusterRounds:
    """A cluster that learned its task in `rounds` = t_i rounds; `links` are directed neighbour links."""

    rounds: float
    robots: int = 2
    links: int = 2


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


def ml_learning_j(gradients_support: float, gradients_query: float, energy: Energy) -> float:
    """Learning part of eq. (9): gamma (support + beta query) P_0 T_0."""
    return energy.pue * (gradients_support + energy.beta * gradients_query) * data_center_gradient_j(energy)


def ml_communication_j(uplink_bytes: float, downlink_bytes: float, energy: Energy) -> float:
    """Communication part of eq. (9): experience up, meta-model down to each robot."""
    uplink_j = transfer_j(uplink_bytes, energy.ul_bit_per_j)
    return uplink_j + transfer_j(downlink_bytes, downlink_bit_per_j(energy))


def fl_learning_j(gradients: float, energy: Energy) -> float:
    """Learning part of eq. (11)."""
    return gradients * robot_gradient_j(energy)


def fl_communication_j(delivered_bytes: float, sent_bytes: float, energy: Energy) -> float:
    """Communication part of eq. (11).

    Direct sidelinks: E_kh on every delivered byte. Via the base station, E_kh = E_k0 + gamma E_0h: the robot sends
    a message up once (`sent_bytes`) and the station delivers it to each neighbour (`delivered_bytes`). With one
    neighbour that is the paper's formula; with more it is cheaper, as a broker needs one copy only.
    """
    if energy.sidelink == "direct":
        return transfer_j(delivered_bytes, energy.sl_bit_per_j)
    down_j = energy.pue * transfer_j(delivered_bytes, downlink_bit_per_j(energy))
    return transfer_j(sent_bytes, energy.ul_bit_per_j) + down_j


def bill(counts: Counts, energy: Energy) -> Bill:
    """The literal price list: eqs. (8)-(12) on `counts`."""
    return Bill(
        ml_learning_j=ml_learning_j(counts.gradients_support, counts.gradients_query, energy),
        ml_communication_j=ml_communication_j(counts.uplink_bytes, counts.downlink_bytes, energy),
        fl_learning_j=fl_learning_j(counts.gradients_robots, energy),
        fl_communication_j=fl_communication_j(counts.sidelink_bytes, counts.sidelink_sent_bytes, energy),
    )


def closed_form(
    t0: float, training_robots: int, clusters: Iterable[ClusterRounds], sizes: RoundSizes = TABLE_I
) -> Counts:
    """The counts that eqs. (9) and (11) assume, from round numbers alone.

    Args:
        t0: MAML rounds; 0 means no meta-model, so nothing goes down either.
        training_robots: robots that send experience, summed over the Q training tasks.
        clusters: one a task, trained or not.
        sizes: batches and bytes of a round; default the paper's Table I.
    """
    clusters = list(clusters)
    robots = sum(cluster.robots for cluster in clusters)
    robot_rounds = sum(cluster.rounds * cluster.robots for cluster in clusters)
    return Counts(
        gradients_support=t0 * training_robots * sizes.support_batches,
        gradients_query=t0 * training_robots * sizes.query_batches,
        gradients_robots=robot_rounds * sizes.robot_batches,
        uplink_bytes=t0 * training_robots * sizes.experience_bytes,
        downlink_bytes=robots * sizes.weights_bytes if t0 > 0 else 0,
        sidelink_bytes=sum(cluster.rounds * cluster.links for cluster in clusters) * sizes.weights_bytes,
        sidelink_sent_bytes=sum(c.rounds * c.robots for c in clusters if c.links) * sizes.weights_bytes,
    )


def directed_links(robots: int, federation: Federation) -> int:
    """Directed neighbour links of a cluster, sum over k of |N_k|."""
    if robots == 1:
        return 0
    if federation.topology == "full":
        return robots * (robots - 1)
    if federation.topology == "ring":
        return robots * min(2, robots - 1)
    return robots * federation.degree


def published_bill(t0: float, fl_rounds: float, energy: Energy) -> PublishedBill | None:
    """The published price list: t0 x 352.4 J + sum of t_i x 246.3 J, or None where the paper implies nothing.

    It holds for the paper's deployment (3 training robots, clusters of 2) and constants, over direct sidelinks, at
    (E_UL, E_SL) = (200, 500) kb/J only; it follows neither PUE nor beta.
    """
    at = (energy.ul_bit_per_j, energy.sl_bit_per_j, energy.sidelink)
    if at != (PUBLISHED_UL_BIT_PER_J, PUBLISHED_SL_BIT_PER_J, "direct"):
        return None
    return PublishedBill(ml_j=t0 * PUBLISHED_ML_ROUND_J, fl_j=fl_rounds * PUBLISHED_FL_ROUND_J)
