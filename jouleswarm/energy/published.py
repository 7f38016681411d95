"""The published price list: what the paper's printed totals come to a round.

That is not what its own equations and constants give: see `jouleswarm/report/audit.py`.
"""

from __future__ import annotations

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.facts import Facts

# Section IV prints 74 kJ for 210 MAML rounds, and 227 kJ for the 921.5 FL rounds of Table II's first row.
PUBLISHED_ML_ROUND_J = 352.4
PUBLISHED_FL_ROUND_J = 246.3
PUBLISHED_UL_BIT_PER_J = 200e3
PUBLISHED_SL_BIT_PER_J = 500e3
TRAINING_ROBOTS = 3  # section IV-A
CLUSTER_ROBOTS = 2  # section IV-A


class Published:
    """Totals a round, of learning by neighbours in the paper's deployment: 3 training robots and clusters of 2.

    They hold for every method whose rounds move and compute what the paper's do: over sidelinks, with or without a
    meta-model before, whichever way that is trained. They tell neither learning from communication nor site from site.
    """

    name, label = "published", "published prices"

    def price(self, facts: Facts, energy: Energy) -> Bill | None:
        """The bill of an arm; None where the paper implies nothing."""
        clusters = {(robots, facts.links[task]) for task, robots in facts.robots.items()}
        papers = facts.training_robots in (None, TRAINING_ROBOTS) and clusters == {(CLUSTER_ROBOTS, CLUSTER_ROBOTS)}
        return published_bill(facts.t0, sum(facts.rounds.values()), energy) if papers else None


def published_bill(t0: float, fl_rounds: float, energy: Energy) -> Bill | None:
    """t0 x 352.4 J + sum of t_i x 246.3 J, or None where the paper implies nothing.

    It holds over direct sidelinks at (E_UL, E_SL) = (200, 500) kb/J only, and follows neither PUE nor beta.
    """
    at = (energy.ul_bit_per_j, energy.sl_bit_per_j, energy.sidelink)
    if at != (PUBLISHED_UL_BIT_PER_J, PUBLISHED_SL_BIT_PER_J, "direct"):
        return None
    return Bill(Cost(untold_j=t0 * PUBLISHED_ML_ROUND_J), Cost(untold_j=fl_rounds * PUBLISHED_FL_ROUND_J))


published = Published()
