"""beta of eq. (9) from what meta-gradients cost."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.learning.heads import head_of
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.methods.beta import Cost, measure_beta

Make = Callable[..., Scenario]


def test_beta_is_what_the_query_gradients_cost_in_plain_ones() -> None:
    # First order: 10 + 10 plain gradients in 2 s, 0.1 s each. Exact: 5 s = 50 of them: 10 adapt, 40 are 4 x 10.
    cost = Cost(10, 10, exact_s=5.0, first_order_s=2.0, exact_flops=300, first_order_flops=200)
    assert cost.beta_time == pytest.approx(4.0)
    assert cost.beta_flops == pytest.approx(2.0)  # 300 = 30 plain ones of 10: 10 + 2 x 10


def test_beta_is_never_below_1() -> None:
    assert Cost(1, 1, exact_s=1.0, first_order_s=2.0, exact_flops=1, first_order_flops=2).beta_time == 1.0


@pytest.mark.parametrize("inner_steps", [1, 3])
def test_going_back_through_the_adaptation_takes_operations_that_first_order_saves(
    inner_steps: int, make_scenario: Make
) -> None:
    scenario = make_scenario()
    last = head_of(build_qnetwork(scenario))
    whole, head = (measure_beta(scenario, adapts, inner_steps, repeats=1) for adapts in (None, last))
    assert whole.exact_flops > whole.first_order_flops
    # the last layer's Hessian is small beside the whole network's
    assert 1 < head.beta_flops < whole.beta_flops
    assert (whole.support_batches, whole.query_batches) == (inner_steps, max(1, round(inner_steps * 3 / 2)))
