"""The literal price list: the energy model, equations (8)-(12), as pure functions: counts and constants in, joules out.

`E` numbers follow the paper's numbered equations: (8)-(9) meta-learning in the data center, (10)-(11) federated
learning on the robots, (12) the total. Gradients are batch gradients, bytes are bytes, 1 kb = 1000 bit. Methods that
the paper does not have are priced cause by cause at the same constants.
"""

from __future__ import annotations

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.facts import Counts, Facts, StageCounts
from jouleswarm.energy.items import BITS_PER_BYTE, items, total


class Literal:
    """The paper's equations as they stand, linear in what was counted."""

    name, label = "literal", "literal prices"

    def price(self, facts: Facts, energy: Energy) -> Bill:
        """The bill of an arm; `energy.beta` is a number. Of robots and links with constants of their own by items."""
        sums_suffice = energy.is_uniform or (energy.is_alike and facts.known_work is None)
        return bill(facts.counts, energy) if sums_suffice else total(items(facts, energy))


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
    """What `counts` cost by cause, linear in them.

    Data center, eq. (9): gamma (support + beta query) P_0 T_0; robots, eq. (11): gradients P_k T_k; every byte at
    8 / efficiency of its link.

    Direct sidelinks: E_kh on every delivered byte. Via the base station, E_kh = E_k0 + gamma E_0h: the robot sends
    a message up once (`sidelink_sent_bytes`) and the station delivers it to each neighbour (`sidelink_bytes`). With
    one neighbour that is the paper's formula; with more it is cheaper, as a broker needs one copy only.

    Raises:
        ConfigurationError: beta is to be the measured one, which only a run's rows know.
    """
    if energy.beta == "measured":
        raise ConfigurationError('beta is "measured", expected a number by now: see jouleswarm/energy/prices.py')
    center_gradients = counts.gradients_support + energy.beta * counts.gradients_query
    down_bit_per_j = downlink_bit_per_j(energy)
    if energy.sidelink == "direct":
        side_robots_j, side_down_j = transfer_j(counts.sidelink_bytes, energy.sl_bit_per_j), 0.0
    else:
        side_robots_j = transfer_j(counts.sidelink_sent_bytes, energy.ul_bit_per_j)
        side_down_j = (energy.base_station_pue or energy.pue) * transfer_j(counts.sidelink_bytes, down_bit_per_j)
    return Cost(
        computing_datacenter_j=energy.pue * center_gradients * data_center_gradient_j(energy),
        computing_robots_j=counts.gradients_robots * robot_gradient_j(energy),
        uplink_j=transfer_j(counts.uplink_bytes, energy.ul_bit_per_j),
        downlink_j=transfer_j(counts.downlink_bytes, down_bit_per_j),
        sidelink_robots_j=side_robots_j,
        sidelink_datacenter_j=side_down_j,
        acting_robots_j=counts.motions * energy.motion_j,
        evaluating_robots_j=counts.evaluation_motions * (energy.motion_j + energy.forward_j),
    )


def bill(counts: StageCounts, energy: Energy) -> Bill:
    """The literal price list on both phases of an arm, eq. (12)."""
    return Bill(price(counts.ml, energy), price(counts.fl, energy))


literal = Literal()
