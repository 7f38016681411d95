"""What meta-learning methods compute of a task with two robots, eqs. (3)-(5), against quadratics worked out by hand."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from jouleswarm.methods.meta import MetaMethod, Rehearsal, Samples
from jouleswarm.methods.shipped import all_shipped

Sample = tuple[float, ...]
INNER_LR = 0.1


def loss(params: dict[str, Tensor], sample: Sample) -> Tensor:
    """Of two robots: (w - a_1)^2 / 2 + (w - a_2)^2 / 2, gradient 2 w - a_1 - a_2, second derivative 2."""
    return torch.stack([0.5 * (params["w"] - each) ** 2 for each in sample]).sum()


def rehearsal(support: list[Sample], query: list[Sample]) -> Rehearsal:
    params = {"w": torch.tensor(1.0, dtype=torch.float64)}
    return Rehearsal(params, Samples(support, query), loss, INNER_LR, float("inf"))  # type: ignore[arg-type]


def method(name: str) -> MetaMethod:
    found = all_shipped()[name]
    assert isinstance(found, MetaMethod)
    return found


# phi = 1 - 0.1 (2 - 0 - 3) = 1.1; there the query gradient is 2.2 - 0 - 1 = 1.2; the Jacobian is 1 - 0.1 x 2 = 0.8.
@pytest.mark.parametrize(("name", "expected"), [("maml", 0.96), ("anil", 0.96), ("fomaml", 1.2)])
def test_adaptation_and_query_are_sums_over_the_robots(name: str, expected: float) -> None:
    gradient, adapted = method(name).gradient(rehearsal([(0.0, 3.0)], [(0.0, 1.0)]))
    assert adapted["w"].item() == pytest.approx(1.1)
    assert gradient["w"].item() == pytest.approx(expected)


def test_the_query_loss_is_a_mean_over_batches_of_sums_over_robots() -> None:
    gradient, _ = method("fomaml").gradient(rehearsal([(0.0, 3.0)], [(0.0, 1.0), (1.0, 2.0)]))
    assert gradient["w"].item() == pytest.approx((1.2 + (2.2 - 3)) / 2)


def test_reptile_goes_the_way_to_where_all_batches_lead() -> None:
    gradient, adapted = method("reptile").gradient(rehearsal([(0.0, 3.0)], [(0.0, 1.0)]))
    # 1.1 after the first, then 1.1 - 0.1 x 1.2 = 0.98
    assert adapted["w"].item() == pytest.approx(0.98)
    assert gradient["w"].item() == pytest.approx(0.02)


def test_joint_training_takes_the_gradient_where_the_model_is() -> None:
    gradient, followed = method("multitask").gradient(rehearsal([(0.0, 3.0)], []))
    assert gradient["w"].item() == pytest.approx(-1.0)
    assert followed["w"].item() == 1.0


def test_a_round_is_cut_into_meta_updates() -> None:
    samples = Samples([(1.0,), (2.0,), (3.0,), (4.0,)], [(5.0,), (6.0,)])  # type: ignore[list-item]
    cut = method("maml").updates(samples, 2)
    assert [(list(each.support), list(each.query)) for each in cut] == [
        ([(1.0,), (2.0,)], [(5.0,)]),
        ([(3.0,), (4.0,)], [(6.0,)]),
    ]
    assert [list(each.support) for each in method("multitask").updates(samples, 2)] == [[(n,)] for n in range(1, 7)]
