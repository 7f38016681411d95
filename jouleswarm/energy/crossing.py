"""Between which efficiencies of links one way to learn costs less than another. Pure.

By eqs. (9) and (11) joules are linear in 1/E_UL and 1/E_SL, so that two bills cross once at most along either.
"""

from __future__ import annotations

from typing import Literal, NamedTuple


class Curve(NamedTuple):
    """Joules (or grams) against one efficiency x, in bit/J: fixed + bits / x."""

    fixed: float
    bits: float

    def at(self, bit_per_j: float) -> float:
        """What it comes to at an efficiency."""
        return self.fixed + self.bits / bit_per_j


class Footprint(NamedTuple):
    """Joules (or grams) against both: fixed + ul_bits / E_UL + sl_bits / E_SL. Footprints add up."""

    fixed: float
    ul_bits: float
    """Over the uplink, and of the downlink what it costs in bits of the uplink."""
    sl_bits: float

    def plus(self, other: Footprint, weight: float = 1.0) -> Footprint:
        """With `weight` times another: a mean, a sum of sites, or grams of sites with intensities of their own."""
        return Footprint(*(one + weight * more for one, more in zip(self, other, strict=True)))

    def at(self, ul_bit_per_j: float, sl_bit_per_j: float) -> float:
        """What it comes to at efficiencies of both."""
        return self.along_sl(ul_bit_per_j).at(sl_bit_per_j)

    def along_sl(self, ul_bit_per_j: float) -> Curve:
        """Against E_SL where E_UL is given."""
        return Curve(self.fixed + self.ul_bits / ul_bit_per_j, self.sl_bits)

    def along_both(self) -> Curve:
        """Where all links have the same efficiency."""
        return Curve(self.fixed, self.ul_bits + self.sl_bits)


NOTHING = Footprint(0.0, 0.0, 0.0)


class Verdict(NamedTuple):
    """Where one curve is below another: always, never, or above or below one efficiency."""

    where: Literal["always", "never", "above", "below"]
    bit_per_j: float | None = None


def cheaper(one: Curve, other: Curve) -> Verdict:
    """At which efficiencies x > 0 `one` costs less than `other`.

    fixed_1 + bits_1 / x = fixed_2 + bits_2 / x at x = (bits_1 - bits_2) / (fixed_2 - fixed_1).
    """
    saved, more_bits = other.fixed - one.fixed, one.bits - other.bits
    if saved > 0:
        return Verdict("above", more_bits / saved) if more_bits > 0 else Verdict("always")
    if more_bits < 0:
        return Verdict("below", more_bits / saved) if saved < 0 else Verdict("always")
    return Verdict("never")
