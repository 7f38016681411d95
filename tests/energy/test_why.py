"""What a bill hangs on, worked out by hand."""

from __future__ import annotations

import pytest

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Counts
from jouleswarm.energy.literal import price
from jouleswarm.energy.why import hangs

# 100 gradients x 5.1 W x 0.4 s = 204 J; 1 MB up at 200 kb/J = 40 J
MINE = Counts(gradients_robots=100, uplink_bytes=1e6)
# 10 gradients = 20.4 J; 2 MB of sidelinks at 500 kb/J = 32 J, 8 MB up = 320 J
OTHER = Counts(gradients_robots=10, uplink_bytes=8e6, sidelink_bytes=2e6)


def _found(mine: Counts, other: Counts | None = None) -> dict[str, tuple[float, float | None]]:
    compared = None if other is None else lambda energy: price(other, energy).total_j
    every = hangs(Energy(), lambda energy: price(mine, energy).total_j, compared)
    return {each.constant: (each.elasticity, each.turns_at) for each in every}


def test_elasticity_is_the_share_of_what_is_proportional_and_minus_it_of_efficiencies() -> None:
    found = _found(MINE)
    assert set(found) == {"pk_w", "tk_batch_s", "ul_bit_per_j"}
    assert found["pk_w"] == (pytest.approx(204 / 244, rel=1e-6), None)
    assert found["tk_batch_s"][0] == pytest.approx(204 / 244, rel=1e-6)
    assert found["ul_bit_per_j"][0] == pytest.approx(-40 / 244, rel=1e-6)


def test_the_value_at_which_the_verdict_turns() -> None:
    found = _found(MINE, OTHER)
    # 204 + 40 against 20.4 + 320 + 32: equal where 183.6 s = 312, s = 1.699346
    assert found["pk_w"][1] == pytest.approx(5.1 * 312 / 183.6)
    # 280 / s = 204 - 20.4 - 32 = 151.6: the uplink would have to be 1.847 times as efficient
    assert found["ul_bit_per_j"][1] == pytest.approx(200e3 * 280 / 151.6)
    # sidelinks are the other's alone; 204 + 40 is less than 340.4 without any: no turning
    assert found["sl_bit_per_j"] == (0.0, None)
