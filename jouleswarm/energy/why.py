"""Why a bill is what it is: each constant's elasticity, and the value at which a verdict turns. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, price

Price = Callable[[Energy], float]
"""Joules of something at other constants."""

CONSTANTS = {
    "p0_w": "P_0",
    "t0_batch_s": "T_0",
    "pk_w": "P_k",
    "tk_batch_s": "T_k",
    "pue": "gamma",
    "beta": "beta",
    "ul_bit_per_j": "E_UL",
    "dl_bit_per_j": "E_DL",
    "sl_bit_per_j": "E_SL",
    "motion_j": "J a motion",
    "forward_j": "J a forward pass",
    "idle_w": "W waiting",
}
"""Numbers of the section energy that a bill may hang on, as the paper writes them."""

_STEP = 1e-4
_DECADES = 6
_PRECISION = 1e-9


class Hang(NamedTuple):
    """How one arm's bill hangs on one constant."""

    constant: str
    value: float
    elasticity: float
    """Relative change of the bill over that of the constant, at its value: 0.7 is 0.7% more for 1% more."""
    turns_at: float | None
    """The nearest value at which the two arms cost the same; None where there is none within six decades."""


def hangs(energy: Energy, mine: Price, other: Price | None = None) -> Iterator[Hang]:
    """How a bill hangs on each constant that moves it, and where it comes to the same as the other one.

    Args:
        energy: with a number for beta.
        mine: the bill's total.
        other: that of what it is compared with.
    """
    for constant in CONSTANTS:
        value = value_of(energy, constant)
        if not value:
            continue
        up, down = (mine(scaled(energy, constant, factor)) for factor in (1 + _STEP, 1 - _STEP))
        if up == down and (other is None or other(scaled(energy, constant, 2.0)) == other(energy)):
            continue
        slope = math.log(up / down) / math.log((1 + _STEP) / (1 - _STEP)) if min(up, down) > 0 else 0.0
        turns = None if other is None else turning(energy, constant, mine, other)
        yield Hang(constant, value, slope, None if turns is None else turns * value)


def value_of(energy: Energy, constant: str) -> float | None:
    """A constant as it holds: E_DL is E_UL where it is not given."""
    if constant == "dl_bit_per_j" and energy.dl_bit_per_j is None:
        return None  # moves with E_UL
    value = getattr(energy, constant)
    return float(value)


def scaled(energy: Energy, constant: str, factor: float) -> Energy:
    """The same with one constant times `factor`; bounds are not looked at."""
    return energy.model_copy(update={constant: getattr(energy, constant) * factor})


def turning(energy: Energy, constant: str, mine: Price, other: Price) -> float | None:
    """The factor of a constant nearest to 1 at which the difference of the bills changes its sign, None where none
    within six decades does; by halving in its logarithm."""

    def difference(exponent: float) -> float:
        here = scaled(energy, constant, 10.0**exponent)
        return mine(here) - other(here)

    start, found = difference(0.0), []
    for way in (1, -1):
        at = next((way * n for n in range(1, _DECADES + 1) if difference(way * n) * start < 0), None)
        if at is not None:
            near, far = float(at - way), float(at)
            while abs(far - near) > _PRECISION:
                middle = (near + far) / 2
                near, far = (near, middle) if difference(middle) * start < 0 else (middle, far)
            found.append((near + far) / 2)
    return 10.0 ** min(found, key=abs) if found else None


def total_of(facts: Facts, prices: PriceList, beta: float | str | None = None) -> Price:
    """An arm's total by a list, at any constants; `beta` of its own in place of theirs."""

    def total(energy: Energy) -> float:
        here = energy if beta is None else energy.model_copy(update={"beta": beta})
        bill = price(prices, facts, here)
        return math.nan if bill is None else bill.total_j

    return total
