"""A network's values, and their gradient into `parameter.grad`: by hand for the stacks that ship, else by autograd.

Around a small network's products autograd takes its time, and leaves a flattened image's gradient in an order that the
layers below are slow on. A plain stack of layers has its gradient in few lines.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

Backward = Callable[[Tensor], None]
"""Takes the slope of a loss in the values; writes the gradient into `parameter.grad`, over what was there."""
Pass = Callable[[Tensor, int], tuple[Tensor, Backward]]
"""Takes float32 [batch, *observation], gives values [batch, actions] and how to go back for the first so many."""

_WITH_WEIGHTS = (nn.Conv2d, nn.Linear)


def values_of(network: nn.Sequential) -> Callable[[Tensor], Tensor]:
    """The network as a function, for where no gradient is asked for."""
    if not _is_plain(network):
        return network
    layers = list(network)
    return lambda x: functools.reduce(lambda values, layer: _forward(layer, values), layers, x)


def pass_of(network: nn.Sequential) -> Pass:
    """For a network whose parameters have gradients already."""
    learns = all(parameter.grad is not None for parameter in network.parameters())
    return _by_hand(network) if learns and _is_plain(network) else _by_autograd(network)


def _is_plain(network: nn.Sequential) -> bool:
    """Whether it is convolutions, one flattening and dense layers, and does nothing else (a subclass, a hook)."""
    layers, kinds = list(network), [type(layer) for layer in network]
    if type(network).forward is not nn.Sequential.forward or kinds.count(nn.Flatten) != 1:
        return False
    flat = kinds.index(nn.Flatten)
    return (
        {*kinds[:flat]} <= {nn.Conv2d, nn.ReLU}
        and {*kinds[flat + 1 :]} <= {nn.Linear, nn.ReLU}
        and kinds[-1] is nn.Linear
        # A value is rectified where it lies, so that it must not be needed as it was.
        and all(kinds[max(index - 1, 0)] in _WITH_WEIGHTS for index, kind in enumerate(kinds) if kind is nn.ReLU)
        and all(_does_no_more(layer) for layer in layers)
        and len({*network.parameters()}) == 2 * sum(kind in _WITH_WEIGHTS for kind in kinds)  # biases; nothing twice
    )


def _does_no_more(layer: nn.Module) -> bool:
    if isinstance(layer, nn.Conv2d) and (layer.padding_mode, layer.padding) != ("zeros", (0, 0)):
        return False
    if isinstance(layer, nn.Flatten) and (layer.start_dim, layer.end_dim) != (1, -1):
        return False
    return not (layer._forward_hooks or layer._forward_pre_hooks or layer._backward_hooks or layer._backward_pre_hooks)


def _by_autograd(network: nn.Sequential) -> Pass:
    def forward(x: Tensor, learned: int) -> tuple[Tensor, Backward]:
        with torch.enable_grad():
            values: Tensor = network(x[:learned])

        def backward(slope: Tensor) -> None:
            for parameter in network.parameters():
                if parameter.grad is not None:
                    parameter.grad.zero_()
            values.backward(slope)  # type: ignore[no-untyped-call]

        with torch.no_grad():
            rest = [network(x[learned:])] if learned < len(x) else []
        return torch.cat([values.detach(), *rest]), backward

    return forward


def _by_hand(network: nn.Sequential) -> Pass:
    layers = list(network)

    def forward(x: Tensor, learned: int) -> tuple[Tensor, Backward]:
        seen = [x]
        for layer in layers:
            seen.append(_forward(layer, seen[-1]))
        return seen[-1], lambda slope: _back(layers, [each[:learned] for each in seen], slope)

    return forward


def _forward(layer: nn.Module, x: Tensor) -> Tensor:
    if isinstance(layer, nn.Conv2d):
        return torch.conv2d(x, layer.weight, layer.bias, layer.stride, 0, layer.dilation, layer.groups)
    if isinstance(layer, nn.Linear):
        assert layer.bias is not None
        return torch.addmm(layer.bias, x, layer.weight.t())
    return x.relu_() if isinstance(layer, nn.ReLU) else x.flatten(1)


def _back(layers: Sequence[nn.Module], seen: Sequence[Tensor], slope: Tensor) -> None:
    first = next(index for index, layer in enumerate(layers) if isinstance(layer, _WITH_WEIGHTS))
    for index in reversed(range(first, len(layers))):
        layer, x = layers[index], seen[index]
        if isinstance(layer, nn.Linear):
            torch.mm(slope.t(), x, out=layer.weight.grad)
            torch.sum(slope, 0, out=layer.bias.grad)
            slope = slope.mm(layer.weight) if index > first else slope
        elif isinstance(layer, nn.Conv2d):
            slope = _convolved_back(layer, x, slope, further=index > first)
        elif isinstance(layer, nn.ReLU):
            slope = torch.ops.aten.threshold_backward(slope, seen[index + 1], 0)
        else:  # convolutions, and what is before them, are several times as fast on images that lie channels last
            slope = slope.reshape(x.shape).contiguous(memory_format=torch.channels_last)


def _convolved_back(layer: nn.Conv2d, x: Tensor, slope: Tensor, *, further: bool) -> Tensor:
    found, weight, bias = torch.ops.aten.convolution_backward(
        slope,
        x,
        layer.weight,
        [layer.out_channels],
        layer.stride,
        (0, 0),
        layer.dilation,
        False,  # not transposed
        (0, 0),
        layer.groups,
        (further, True, True),
    )
    for parameter, gradient in zip(layer.parameters(), (weight, bias), strict=True):
        assert parameter.grad is not None
        parameter.grad.copy_(gradient)
    return found if further else slope
