"""The data center's gradients by hand, against autograd's of the same loss; and which losses have one."""

import pytest
import torch
from torch import Tensor, nn

from jouleswarm.common.scenario.sections import Network
from jouleswarm.learning.meta import meta_gradient, plain_gradient, query_loss
from jouleswarm.learning.passes import Params
from jouleswarm.learning.task_loss import ByHand, TensorBatch, make_loss, sum_of
from tests.made_up import qnetwork

SHIPPED = Network(width=16, height=12, conv=((8, 4, 2), (16, 3, 1)), dense=(32, 8))


def params_of(network: nn.Module, seed: int) -> Params:
    generator = torch.Generator().manual_seed(seed)
    return {
        name: value.detach() + 0.1 * torch.randn(value.shape, generator=generator)
        for name, value in network.named_parameters()
    }


def batch(seed: int, size: int = 5) -> TensorBatch:
    generator = torch.Generator().manual_seed(seed)
    frames, next_frames = (torch.randn(size, 4, 12, 16, generator=generator) for _ in range(2))
    ended = torch.randint(0, 2, (size,), generator=generator).to(torch.float32)
    rewards, actions = torch.randn(size, generator=generator), torch.randint(0, 4, (size,), generator=generator)
    return TensorBatch(frames, actions, rewards, next_frames, ended)


def by_autograd(loss: object, params: Params) -> Params:
    leaves = {name: value.clone().requires_grad_() for name, value in params.items()}
    value: Tensor = loss(leaves)  # type: ignore[operator]
    return dict(zip(leaves, torch.autograd.grad(value, list(leaves.values())), strict=True))


@pytest.mark.parametrize("double", [True, False])
def test_the_gradient_by_hand_is_autograds_mean_over_samples_of_sums_over_robots(double: bool) -> None:
    network = qnetwork(SHIPPED, 1)
    loss = sum_of(make_loss(network, params_of(network, 2), 0.9, double=double))
    samples = [(batch(3), batch(4, size=7)), (batch(5),), (batch(6),)]
    assert isinstance(loss, ByHand)
    params = params_of(network, 1)
    found = plain_gradient(loss, params, samples)
    expected = by_autograd(lambda at: query_loss(at, samples, loss), params)
    assert list(found) == list(expected)
    for name, gradient in expected.items():
        assert gradient.any(), name
        torch.testing.assert_close(found[name], gradient)


def test_a_first_order_step_by_hand_adapts_and_goes_back_as_autograd_does() -> None:
    network = qnetwork(SHIPPED, 1)
    loss = make_loss(network, params_of(network, 2), 0.9, double=True)
    params = params_of(network, 1)
    gradient, adapted = meta_gradient(params, [batch(3)], [batch(4)], loss, 0.05, exact=False)
    step = by_autograd(lambda at: loss(at, batch(3)), params)
    expected = {name: value - 0.05 * step[name] for name, value in params.items()}
    torch.testing.assert_close(adapted, expected)
    torch.testing.assert_close(gradient, by_autograd(lambda at: loss(at, batch(4)), expected))


def test_some_parameters_alone_have_the_gradient_that_they_have_among_all() -> None:
    network = qnetwork(SHIPPED, 1)
    loss, params = make_loss(network, params_of(network, 2), 0.9, double=True), params_of(network, 1)
    assert isinstance(loss, ByHand)
    every, of = plain_gradient(loss, params, [batch(3)]), ["9.weight", "9.bias"]
    some = plain_gradient(loss, params, [batch(3)], of)
    assert list(some) == of
    assert all(torch.equal(some[name], every[name]) for name in of)


def test_a_network_that_does_more_goes_by_autograd() -> None:
    network = nn.Sequential(nn.Flatten(), nn.Linear(4 * 12 * 16, 6), nn.Tanh(), nn.Linear(6, 4))
    loss, params = make_loss(network, params_of(network, 2), 0.9, double=True), params_of(network, 1)
    assert not isinstance(loss, ByHand)
    assert not isinstance(sum_of(loss), ByHand)
    torch.testing.assert_close(
        plain_gradient(loss, params, [batch(3)]), by_autograd(lambda at: loss(at, batch(3)), params)
    )
