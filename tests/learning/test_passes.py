"""Values and gradients by hand, against PyTorch's own; and where autograd is asked."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from jouleswarm.common.scenario.sections import Network
from jouleswarm.learning.flat import Flat
from jouleswarm.learning.passes import pass_of, values_of
from jouleswarm.learning.qnetwork import QNetwork
from tests.made_up import qnetwork

SHIPPED = Network(width=16, height=12, conv=((8, 4, 2), (16, 3, 1)), dense=(32, 8))


def images(batch: int) -> Tensor:
    made = torch.randn(batch, 4, 12, 16, generator=torch.Generator().manual_seed(1))
    return made.contiguous(memory_format=torch.channels_last)


class Doubled(nn.Linear):
    def forward(self, x: Tensor) -> Tensor:
        return 2 * super().forward(x)


def padded() -> QNetwork:
    return QNetwork(nn.Conv2d(4, 2, 3, padding=1), nn.ReLU(), nn.Flatten(), nn.Linear(2 * 12 * 16, 4))


def hooked() -> QNetwork:
    made = QNetwork(nn.Flatten(), nn.Linear(4 * 12 * 16, 4))
    made[1].register_forward_hook(lambda _layer, _taken, given: 2 * given)
    return made


NETWORKS: dict[str, Callable[[], QNetwork]] = {
    "shipped": lambda: qnetwork(SHIPPED, 1),
    "dense only": lambda: QNetwork(nn.Flatten(), nn.Linear(4 * 12 * 16, 6), nn.ReLU(), nn.Linear(6, 4)),
    "strided, dilated, grouped": lambda: QNetwork(
        nn.Conv2d(4, 6, 3, stride=2, dilation=2, groups=2), nn.ReLU(), nn.Flatten(), nn.Linear(6 * 4 * 6, 4)
    ),
    "padded": padded,
    "hooked": hooked,
    "a layer of the user's": lambda: QNetwork(nn.Flatten(), Doubled(4 * 12 * 16, 4)),
    "no bias": lambda: QNetwork(nn.Flatten(), nn.Linear(4 * 12 * 16, 4, bias=False)),
    "rectified before": lambda: QNetwork(nn.ReLU(), nn.Flatten(), nn.Linear(4 * 12 * 16, 4)),
    "tanh": lambda: QNetwork(nn.Flatten(), nn.Linear(4 * 12 * 16, 6), nn.Tanh(), nn.Linear(6, 4)),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_values_and_gradients_are_those_of_autograd(name: str) -> None:
    torch.manual_seed(1)
    network, slope, x = NETWORKS[name](), torch.randn(5, 4, generator=torch.Generator().manual_seed(2)), images(8)
    expected = network(x).detach()
    network(x[:5]).backward(slope)
    gradients = [parameter.grad for parameter in network.parameters()]
    flat = Flat(network, gradients=True)
    assert flat.values.grad is not None
    flat.values.grad.fill_(7.0)  # what was there is written over
    given = x.clone(memory_format=torch.preserve_format)
    with torch.no_grad():
        values, backward = pass_of(network)(given, 5)
        backward(slope)
        torch.testing.assert_close(values_of(network)(given), expected)
    torch.testing.assert_close(values, expected)
    assert torch.equal(given, x)  # nothing is rectified in place that is the caller's
    for parameter, gradient in zip(network.parameters(), gradients, strict=True):
        torch.testing.assert_close(parameter.grad, gradient)


def test_what_ships_goes_by_hand_and_what_does_more_by_autograd() -> None:
    by_hand = [name for name, build in NETWORKS.items() if values_of(network := build()) is not network]
    assert by_hand == ["shipped", "dense only", "strided, dilated, grouped"]


def test_parameters_in_one_buffer_keep_values_and_order_in_memory_and_follow_it() -> None:
    network = qnetwork(SHIPPED, 1)
    before = [(parameter.detach().clone(), parameter.stride()) for parameter in network.parameters()]
    flat = Flat(network)
    for parameter, (value, stride) in zip(network.parameters(), before, strict=True):
        assert torch.equal(parameter, value)
        assert parameter.stride() == stride
    flat.values.mul_(2.0)
    assert all(
        torch.equal(parameter, 2 * value) for parameter, (value, _) in zip(network.parameters(), before, strict=True)
    )


def test_a_gradient_is_shortened_to_the_norm_and_a_shorter_one_stays() -> None:
    flat = Flat(nn.Linear(2, 1, bias=False), gradients=True)
    assert flat.values.grad is not None
    flat.values.grad[:2] = torch.tensor([3.0, 4.0])  # norm 5
    flat.clip(10.0)
    assert flat.values.grad[:2].tolist() == [3.0, 4.0]
    flat.clip(1.0)
    assert flat.values.grad[:2].tolist() == pytest.approx([0.6, 0.8], rel=1e-6)
