"""A network's values, and their gradient into `parameter.grad`: by hand for the stacks that ship, else by autograd.

Of a small network's gradient step a good part is what autograd does around the products; a plain stack of layers has its
gradient in one line a layer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

Backward = Callable[[Tensor], None]
"""Takes the slope of a loss in the values; writes the gradient into `parameter.grad`, over what was there."""
Pass = Callable[[Tensor], tuple[Tensor, Backward]]
"""Takes float32 [batch, *observation], gives values [batch, actions] and how to go back."""

_PLAIN = (nn.Conv2d, nn.Linear, nn.ReLU, nn.Flatten)


def pass_of(network: nn.Sequential) -> Pass:
    """For a network whose parameters have gradients already."""
    return _by_hand(network) if _is_plain(network) else _by_autograd(network)


def _is_plain(network: nn.Sequential) -> bool:
    """Whether each layer is one that `_by_hand` knows, and does nothing else (a subclass, a hook) on the way."""
    told = [str(layer) for layer in network]
    kinds = [type(layer) for layer in network]
    return (
        type(network).forward is nn.Sequential.forward
        and all(kind in _PLAIN for kind in kinds)
        and not any(layer._forward_hooks or layer._forward_pre_hooks or layer._backward_hooks for layer in network)
        and all(parameter.requires_grad for parameter in network.parameters())
        and len(list(network.parameters())) == 2 * (kinds.count(nn.Conv2d) + kinds.count(nn.Linear))
        and all(
            layer.padding_mode == "zeros" and layer.padding == (0, 0)
            for layer in network
            if isinstance(layer, nn.Conv2d)
        )
        and all(said == str(nn.Flatten()) for said, kind in zip(told, kinds, strict=True) if kind is nn.Flatten)
        # A value is rectified where it lies, so that it must not be needed as it was.
        and kinds[-1] is nn.Linear
        and all(one in (nn.Conv2d, nn.Linear) for one, other in pairwise(kinds) if other is nn.ReLU)
    )


def _by_autograd(network: nn.Sequential) -> Pass:
    def forward(x: Tensor) -> tuple[Tensor, Backward]:
        with torch.enable_grad():
            values: Tensor = network(x)

        def backward(slope: Tensor) -> None:
            for parameter in network.parameters():
                if parameter.grad is not None:
                    parameter.grad.zero_()
            values.backward(slope)  # type: ignore[no-untyped-call]

        return values.detach(), backward

    return forward


def _by_hand(network: nn.Sequential) -> Pass:
    layers = list(network)

    def forward(x: Tensor) -> tuple[Tensor, Backward]:
        seen = [x]
        for layer in layers:
            seen.append(_forward(layer, seen[-1]))
        return seen[-1], lambda slope: _back(layers, seen, slope)

    return forward


def _forward(layer: nn.Module, x: Tensor) -> Tensor:
    if isinstance(layer, nn.Conv2d):
        return torch.conv2d(x, layer.weight, layer.bias, layer.stride, 0, layer.dilation, layer.groups)
    if isinstance(layer, nn.Linear):
        assert layer.bias is not None
        return torch.addmm(layer.bias, x, layer.weight.t())
    return x.relu_() if isinstance(layer, nn.ReLU) else x.flatten(1)


def _back(layers: Sequence[nn.Module], seen: Sequence[Tensor], slope: Tensor) -> None:
    for index in reversed(range(len(layers))):
        layer, x = layers[index], seen[index]
        if isinstance(layer, nn.Linear):
            torch.mm(slope.t(), x, out=layer.weight.grad)
            torch.sum(slope, 0, out=layer.bias.grad)
            slope = slope.mm(layer.weight) if index else slope
        elif isinstance(layer, nn.Conv2d):
            slope, weight, bias = torch.ops.aten.convolution_backward(
                slope, x, layer.weight, layer.bias.shape, layer.stride, (0, 0), layer.dilation, False, (0, 0),
                layer.groups, (index > 0, True, True),
            )  # fmt: skip
            layer.weight.grad.copy_(weight)
            layer.bias.grad.copy_(bias)
        elif isinstance(layer, nn.ReLU):
            slope = torch.ops.aten.threshold_backward(slope, seen[index + 1], 0)
        elif x.dim() > 2:  # what the flattening is undone to has the images' order in memory, channels last
            slope = slope.reshape(x.shape).contiguous(memory_format=torch.channels_last)
