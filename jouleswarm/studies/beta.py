"""The equations at beta = 1, beside the measured one: what an exact meta-gradient is priced at by Table I alone."""

from __future__ import annotations

from collections.abc import Sequence

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList

MEASURED = 'energy.beta="measured"'
"""The override that has the data center measure it."""


class AtBeta1:
    """Literal prices whatever beta was measured: Table I gives none, and beta = 1 is its gradients as they are."""

    name, label = "beta1", "literal, beta = 1"

    def price(self, facts: Facts, energy: Energy) -> Bill:
        """The bill of an arm."""
        return literal.price(facts, energy.model_copy(update={"beta": 1.0}))


BETA_1 = AtBeta1()


def with_beta_1(lists: Sequence[PriceList], energy: Energy) -> tuple[PriceList, ...]:
    """The lists, and after them that at beta = 1 where another beta is priced."""
    return (*lists, BETA_1) if energy.beta != 1 else tuple(lists)
