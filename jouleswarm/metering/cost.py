"""What some of a meter's rows cost, by themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from jouleswarm.common.meter.tally import Row
from jouleswarm.common.scenario.tariff import Tariff
from jouleswarm.energy.calculator import facts_of
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import price, price_lists
from jouleswarm.energy.rows import read_rows
from jouleswarm.metering.metered import Metered
from jouleswarm.metering.written import bill_rows, delivered_of

Cost = Callable[[Sequence[Row]], float]
"""Joules of rows."""
Done = Callable[[Sequence[Row]], tuple[Facts, ...]]
"""What rows come to before prices: facts of each arm."""


def cost_of(metered: Metered, tariff: Tariff) -> Cost:
    """By the tariff's first price list; what is computed is in none of the rows.

    Raises (when it is called):
        ConfigurationError: the tariff asks for what the rows don't tell, of who sent something say.
    """
    (prices, *_), done = price_lists(tariff), done_of(metered, tariff)

    def joules(rows: Sequence[Row]) -> float:
        bills = (price(prices, each, tariff.energy) for each in done(rows))
        return sum(bill.total_j for bill in bills if bill is not None)

    return joules


def done_of(metered: Metered, tariff: Tariff) -> Done:
    """The same without prices, for who prices it again and again.

    Raises (when it is called):
        ConfigurationError: as `cost_of`.
    """
    delivered = delivered_of(metered.rows)

    def done(rows: Sequence[Row]) -> tuple[Facts, ...]:
        counted = bill_rows(rows, metered.rules, metered.numbers, delivered)
        return tuple(facts_of(read_rows(counted), by_robot=tariff.is_by_robot).values()) if counted else ()

    return done
