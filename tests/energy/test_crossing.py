"""Where one bill is below another, worked out by hand."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.energy.crossing import Curve, Footprint, Verdict, cheaper


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (Curve(100, 5000), Curve(200, 1000), Verdict("above", 40.0)),  # 4000 bits more against 100 J less
        (Curve(200, 1000), Curve(100, 5000), Verdict("below", 40.0)),
        (Curve(100, 1000), Curve(200, 1000), Verdict("always")),
        (Curve(100, 1000), Curve(100, 2000), Verdict("always")),
        (Curve(200, 1000), Curve(100, 1000), Verdict("never")),
        (Curve(100, 2000), Curve(100, 1000), Verdict("never")),
        (Curve(100, 1000), Curve(100, 1000), Verdict("never")),  # nor the other way round
    ],
)
def test_two_curves_cross_once_at_most(one: Curve, other: Curve, expected: Verdict) -> None:
    assert cheaper(one, other) == expected


amounts = st.floats(0, 1e6, allow_subnormal=False).map(lambda value: round(value, 3))


@given(amounts, amounts, amounts, amounts, st.floats(1e-3, 1e9))
def test_a_verdict_is_what_both_come_to(a: float, b: float, c: float, d: float, x: float) -> None:
    one, other = Curve(a, b), Curve(c, d)
    where, at = cheaper(one, other)
    if at is not None and abs(x - at) <= 1e-6 * at:
        return
    said = where == "always" or (at is not None and (x > at if where == "above" else x < at))
    mine, theirs = one.at(x), other.at(x)
    assert said == (mine < theirs) or mine == pytest.approx(theirs, rel=1e-9)


def test_a_footprint_is_cut_along_either_efficiency() -> None:
    held = Footprint(10, 600, 200)
    assert held.along_sl(20) == Curve(10 + 30, 200)
    assert held.along_both() == Curve(10, 800)
    assert held.at(20, 100) == 10 + 30 + 2
    assert held.plus(Footprint(1, 2, 3), 10) == Footprint(20, 620, 230)
