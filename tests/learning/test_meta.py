"""MAML, eqs. (3)-(5), against a quadratic worked out by hand and against finite differences of the real loss."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from jouleswarm.common.scenario.sections import Network
from jouleswarm.learning.meta import (
    Params,
    adapt,
    clipped,
    meta_gradient,
    query_loss,
)
from jouleswarm.learning.replay import Batch
from jouleswarm.learning.task_loss import TensorBatch, make_loss, to_tensors
from tests.made_up import qnetwork


def goal(value: float) -> TensorBatch:
    """A batch that carries nothing but the quadratic's minimum."""
    return TensorBatch(*(torch.tensor([value], dtype=torch.float64) for _ in range(5)))


def quadratic(params: Params, batch: TensorBatch) -> Tensor:
    """(w - c)^2 / 2: gradient w - c, second derivative 1."""
    return 0.5 * ((params["w"] - batch.rewards) ** 2).sum()


def start(*values: float) -> Params:
    return {"w": torch.tensor(values, dtype=torch.float64)}


def test_adaptation_takes_one_sgd_step_a_support_batch() -> None:
    adapted = adapt(start(1.0), [goal(3.0), goal(0.0)], quadratic, inner_lr=0.1)
    # 1 - 0.1 (1 - 3) = 1.2, then 1.2 - 0.1 (1.2 - 0) = 1.08
    assert adapted["w"].item() == pytest.approx(1.08)


def test_adaptation_leaves_the_meta_model_alone() -> None:
    params = start(1.0)
    adapt(params, [goal(3.0)], quadratic, inner_lr=0.1)
    assert params["w"].item() == 1.0


def test_query_loss_is_the_mean_over_its_batches() -> None:
    assert query_loss(start(1.0), [goal(3.0), goal(0.0)], quadratic).item() == pytest.approx((2.0 + 0.5) / 2)


def test_the_exact_meta_gradient_carries_the_jacobian_of_every_inner_step() -> None:
    gradient, adapted = meta_gradient(start(1.0), [goal(3.0), goal(0.0)], [goal(2.0)], quadratic, 0.1, exact=True)
    # phi = 1.08; d phi / d w = (1 - 0.1)^2; gradient (1.08 - 2) x 0.81
    assert gradient["w"].item() == pytest.approx(-0.92 * 0.81)
    assert adapted["w"].item() == pytest.approx(1.08)


def test_the_first_order_meta_gradient_is_the_gradient_at_phi() -> None:
    gradient, adapted = meta_gradient(start(1.0), [goal(3.0), goal(0.0)], [goal(2.0)], quadratic, 0.1, exact=False)
    assert gradient["w"].item() == pytest.approx(-0.92)
    assert adapted["w"].item() == pytest.approx(1.08)


def rates(*values: float) -> Params:
    """log mu of the layers a, b, ..."""
    return {f"log_mu/{layer}": torch.tensor(math.log(value)) for layer, value in zip("ab", values, strict=False)}


def two_layers(params: Params, batch: TensorBatch) -> Tensor:
    """Of the layers a and b: (w_a - c)^2 / 2 + (w_b - c)^2 / 2."""
    return 0.5 * sum(((value - batch.rewards) ** 2).sum() for value in params.values())  # type: ignore[return-value]


TWO_LAYERS = {"a.weight": torch.tensor([1.0]).double(), "b.weight": torch.tensor([2.0]).double()}


def test_each_layer_adapts_by_its_own_learned_step_size() -> None:
    adapted = adapt(TWO_LAYERS, [goal(3.0)], two_layers, rates(0.1, 0.5))
    # 1 - 0.1 (1 - 3) = 1.2; 2 - 0.5 (2 - 3) = 2.5
    assert adapted["a.weight"].item() == pytest.approx(1.2)
    assert adapted["b.weight"].item() == pytest.approx(2.5)


@pytest.mark.parametrize("exact", [True, False])
def test_of_one_step_the_gradient_of_mu_is_query_times_support_gradient(exact: bool) -> None:
    gradient, _ = meta_gradient(TWO_LAYERS, [goal(3.0)], [goal(0.0)], two_layers, rates(0.1, 0.5), exact=exact)
    # d L / d mu = -g_query g_support, and d mu / d log mu = mu:
    assert gradient["log_mu/a"].item() == pytest.approx(-(1.2 * -2.0) * 0.1)
    assert gradient["log_mu/b"].item() == pytest.approx(-(2.5 * -1.0) * 0.5)


def test_of_two_steps_the_exact_gradient_of_mu_goes_back_through_the_second() -> None:
    params, support, query = {"a.w": torch.tensor([1.0]).double()}, [goal(3.0), goal(0.0)], [goal(2.0)]
    exact, _ = meta_gradient(params, support, query, two_layers, rates(0.1), exact=True)
    first, _ = meta_gradient(params, support, query, two_layers, rates(0.1), exact=False)
    # phi_1 = 1 - mu (1 - 3) = 1 + 2 mu, phi = (1 - mu) (1 + 2 mu): d phi / d mu = 1 - 4 mu = 0.6; g_query = 1.08 - 2
    assert exact["log_mu/a"].item() == pytest.approx(-0.92 * 0.6 * 0.1)
    # as constants the two support gradients are -2 and 1.2: d phi / d mu = 0.8
    assert first["log_mu/a"].item() == pytest.approx(-0.92 * 0.8 * 0.1)
    assert exact["a.w"].item() == pytest.approx(-0.92 * 0.81)  # as with a mu that is not learned
    assert first["a.w"].item() == pytest.approx(-0.92)


def test_a_layer_that_does_not_adapt_has_no_gradient_of_mu() -> None:
    gradient, _ = meta_gradient(
        TWO_LAYERS, [goal(3.0)], [goal(0.0)], two_layers, rates(0.1, 0.5), exact=True, inner=["b.weight"]
    )
    assert gradient["log_mu/a"].item() == 0.0
    assert gradient["log_mu/b"].item() == pytest.approx(1.25)


def test_what_comes_out_does_not_hold_the_graph() -> None:
    for exact in (True, False):
        gradient, adapted = meta_gradient(start(1.0), [goal(3.0)], [goal(2.0)], quadratic, 0.1, exact=exact)
        assert not gradient["w"].requires_grad
        assert not adapted["w"].requires_grad


MODEL = nn.Sequential(nn.Flatten(), nn.Linear(4, 3), nn.Tanh(), nn.Linear(3, 4)).double()


def random_batch(seed: int, size: int = 6) -> TensorBatch:
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    return TensorBatch(
        normal(size, 4, 1, 1),
        torch.randint(4, (size,), generator=generator),
        normal(size),
        normal(size, 4, 1, 1),
        (torch.rand(size, generator=generator) < 0.3).double(),
    )


def random_params(seed: int) -> Params:
    generator = torch.Generator().manual_seed(seed)
    return {
        name: torch.randn(value.shape, generator=generator, dtype=torch.float64)
        for name, value in MODEL.named_parameters()
    }


@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("steps", [1, 3])
def test_the_exact_meta_gradient_is_the_slope_of_the_adapted_loss(double: bool, steps: int) -> None:
    params, target, inner_lr = random_params(1), random_params(2), 0.05
    support, query = [random_batch(10 + step) for step in range(steps)], [random_batch(20), random_batch(21)]
    loss = make_loss(MODEL, target, 0.9, double=double)
    exact, _ = meta_gradient(params, support, query, loss, inner_lr, exact=True)
    first, _ = meta_gradient(params, support, query, loss, inner_lr, exact=False)

    def adapted_loss(at: Params) -> float:
        return query_loss(adapt(at, support, loss, inner_lr), query, loss).item()

    step, slopes = 1e-6, {}
    for name, value in params.items():
        slope = torch.zeros_like(value)
        for place in np.ndindex(*value.shape):
            up, down = value.clone(), value.clone()
            up[place] += step
            down[place] -= step
            slope[place] = (adapted_loss({**params, name: up}) - adapted_loss({**params, name: down})) / (2 * step)
        slopes[name] = slope
    for name, slope in slopes.items():
        torch.testing.assert_close(exact[name], slope, rtol=1e-5, atol=1e-7)
    assert any(not torch.allclose(first[name], exact[name], rtol=1e-3) for name in first)


def test_first_order_equals_the_plain_gradient_at_the_adapted_parameters() -> None:
    params, target = random_params(1), random_params(2)
    support, query = [random_batch(10)], [random_batch(20), random_batch(21)]
    loss = make_loss(MODEL, target, 0.9, double=True)
    first, adapted = meta_gradient(params, support, query, loss, 0.05, exact=False)
    leaves = {name: value.clone().requires_grad_() for name, value in adapted.items()}
    query_loss(leaves, query, loss).backward()
    for name, leaf in leaves.items():
        assert leaf.grad is not None
        torch.testing.assert_close(first[name], leaf.grad)


def linear_q(values: list[float]) -> Params:
    return {"1.weight": torch.zeros(4, 4), "1.bias": torch.tensor(values)}


LINEAR = nn.Sequential(nn.Flatten(), nn.Linear(4, 4))


@pytest.mark.parametrize(("double", "expected"), [(True, 0.5 * 1.0), (False, 0.5 * 4.0)])
def test_the_loss_uses_the_tasks_target_network(double: bool, expected: float) -> None:
    # Online: action 1 is best; the target network values it at 1 and action 0 at 4. Q of action 3 is 0, reward 0.
    loss = make_loss(LINEAR, linear_q([4.0, 1.0, 0.0, 0.0]), 0.5, double=double)
    zeros = torch.zeros(1, 4, 1, 1)
    batch = TensorBatch(zeros, torch.tensor([3]), torch.zeros(1), zeros, torch.zeros(1))
    huber = 0.5 * expected**2 if expected < 1 else expected - 0.5
    assert loss(linear_q([0.0, 3.0, 0.0, 0.0]), batch).item() == pytest.approx(huber)


def test_no_gradient_flows_through_the_target() -> None:
    loss = make_loss(LINEAR, linear_q([4.0, 1.0, 0.0, 0.0]), 0.5, double=True)
    params = {name: value.requires_grad_() for name, value in linear_q([0.0, 3.0, 0.0, 0.0]).items()}
    zeros = torch.zeros(1, 4, 1, 1)
    loss(params, TensorBatch(zeros, torch.tensor([3]), torch.zeros(1), zeros, torch.zeros(1))).backward()
    assert params["1.bias"].grad is not None
    assert params["1.bias"].grad.tolist() == [0.0, 0.0, 0.0, -0.5]  # of Q(3) alone: error 0 - 0.5


def test_a_replayed_batch_becomes_observations() -> None:
    frames = np.full((2, 1, 1, 4), 192, np.uint8)
    batch = Batch(frames, np.array([1, 2]), np.array([0.5, 1.5], np.float32), frames, np.array([0, 1], np.float32))
    tensors = to_tensors(batch, qnetwork(Network(width=1, height=1, conv=())), torch.device("cpu"))
    assert tensors.frames.tolist() == [[[[1.0]]] * 4] * 2  # (192 - 128) / 64
    assert tensors.next_frames.shape == (2, 4, 1, 1)
    assert tensors.actions.tolist() == [1, 2]
    assert tensors.rewards.tolist() == [0.5, 1.5]
    assert tensors.terminated.tolist() == [0.0, 1.0]


def test_a_long_gradient_is_shortened_and_a_short_one_is_not() -> None:
    gradient = {"a": torch.tensor([3.0, 0.0]), "b": torch.tensor([4.0])}  # 2-norm 5
    shortened = clipped(gradient, 1.0)
    assert torch.allclose(shortened["a"], torch.tensor([0.6, 0.0]))
    assert torch.allclose(shortened["b"], torch.tensor([0.8]))
    assert torch.allclose(clipped(gradient, 6.0)["b"], torch.tensor([4.0]))


@pytest.mark.parametrize("norm", [1.0, 1e-9])
def test_a_gradient_of_exactly_zero_is_left_alone_and_has_a_slope(norm: float) -> None:
    value = torch.zeros(3, requires_grad=True)
    shortened = clipped({"w": 2 * value}, norm)["w"]
    assert shortened.tolist() == [0.0, 0.0, 0.0]
    (slope,) = torch.autograd.grad(shortened.sum(), value)
    assert slope.tolist() == [2.0, 2.0, 2.0]


def test_what_is_clipped_and_its_slope_are_as_the_formula_says() -> None:
    # g = 2v of length 10, clipped to 1: v/5. Along v nothing moves; across it the slope is 2 / 10.
    value = torch.tensor([3.0, 4.0], dtype=torch.float64, requires_grad=True)
    shortened = clipped({"w": 2 * value}, 1.0)["w"]
    along, across = (
        torch.autograd.grad(shortened, value, torch.tensor(way, dtype=torch.float64), retain_graph=True)[0].tolist()
        for way in ([0.6, 0.8], [-0.8, 0.6])
    )
    assert shortened.tolist() == pytest.approx([0.6, 0.8], rel=1e-6)
    assert along == pytest.approx([0.0, 0.0], abs=1e-6)
    assert across == pytest.approx([-0.16, 0.12], rel=1e-6)
