"""A network's values, and their gradient: by hand for the stacks that ship, else by autograd.

Around a small network's products autograd takes its time, and leaves a flattened image's gradient in an order that the
layers below are slow on. A plain stack of layers has its gradient in few lines.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial

import torch
from torch import Tensor, nn

Backward = Callable[[Tensor], object]
"""Takes the slope of a loss in the values; writes the gradient into `parameter.grad`, over what was there."""
Pass = Callable[[Tensor, int], tuple[Tensor, Backward]]
"""Takes float32 [batch, *observation], gives values [batch, actions] and how to go back for the first so many."""
Params = dict[str, Tensor]
Gradient = Callable[[Tensor, Params], None]
"""Takes the slope of a loss in the values; writes the gradient by parameters' names, over what is there or anew."""
Pair = tuple[Tensor, Tensor]
"""A layer's weight and bias."""

_WITH_WEIGHTS = (nn.Conv2d, nn.Linear)


def values_of(network: nn.Sequential) -> Callable[[Tensor], Tensor]:
    """The network as a function, for where no gradient is asked for."""
    if not is_plain(network):
        return network
    stack = Stack(network)
    pairs = stack.pairs(dict(network.named_parameters()))
    return lambda x: stack.values(pairs, x)


def pass_of(network: nn.Sequential) -> Pass:
    """For a network whose parameters have gradients already: into these it is written."""
    gradients = {name: parameter.grad for name, parameter in network.named_parameters() if parameter.grad is not None}
    if len(gradients) < len(list(network.parameters())) or not is_plain(network):
        return _by_autograd(network)
    stack = Stack(network)
    pairs = stack.pairs(dict(network.named_parameters()))

    def forward(x: Tensor, learned: int) -> tuple[Tensor, Backward]:
        values, gradient = stack.there_and_back(pairs, x, learned)
        return values, lambda slope: gradient(slope, gradients)

    return forward


def is_plain(network: nn.Sequential) -> bool:
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


class Stack:
    """The layers of a plain network (`is_plain`), with parameters that are given."""

    def __init__(self, network: nn.Sequential) -> None:
        self._layers = list(network)
        self._names = [(f"{name}.weight", f"{name}.bias") for name, _ in network.named_children()]
        self._lowest = self._lowest_of([name for names in self._names for name in names])

    def pairs(self, params: Params) -> list[Pair | None]:
        """Parameters layer by layer."""
        return [
            (params[weight], params[bias]) if isinstance(layer, _WITH_WEIGHTS) else None
            for layer, (weight, bias) in zip(self._layers, self._names, strict=True)
        ]

    def values(self, pairs: Sequence[Pair | None], x: Tensor) -> Tensor:
        """[batch, actions]; not to be differentiated."""
        for layer, pair in zip(self._layers, pairs, strict=True):
            x = _forward(layer, pair, x)
        return x

    def differentiable(self, params: Params, x: Tensor) -> Tensor:
        """The same, for autograd."""
        for layer, pair in zip(self._layers, self.pairs(params), strict=True):
            if isinstance(layer, nn.Flatten) and x.dim() == 4 and x.requires_grad:
                x.register_hook(_channels_last)  # type: ignore[no-untyped-call]
            x = x.relu() if isinstance(layer, nn.ReLU) else _forward(layer, pair, x)
        return x

    def there_and_back(
        self, pairs: Sequence[Pair | None], x: Tensor, learned: int, of: Collection[str] | None = None
    ) -> tuple[Tensor, Gradient]:
        """Values of all observations, and how to go back for the first so many: down to the lowest of the parameters
        `of`, by default of all."""
        seen = [x]
        for layer, pair in zip(self._layers, pairs, strict=True):
            seen.append(_forward(layer, pair, seen[-1]))
        first = self._lowest if of is None else self._lowest_of(of)
        return seen[-1], partial(self._back, first, pairs, [each[:learned] for each in seen])

    def _lowest_of(self, names: Collection[str]) -> int:
        layers = zip(self._layers, self._names, strict=True)
        return next(
            index
            for index, (layer, own) in enumerate(layers)
            if isinstance(layer, _WITH_WEIGHTS) and not {*own}.isdisjoint(names)
        )

    def _back(
        self, first: int, pairs: Sequence[Pair | None], seen: Sequence[Tensor], slope: Tensor, into: Params
    ) -> None:
        for index in reversed(range(first, len(pairs))):
            layer, x, pair, (weight, bias) = self._layers[index], seen[index], pairs[index], self._names[index]
            if isinstance(layer, nn.Conv2d) and pair is not None:
                slope, *found = _convolved_back(layer, pair[0], x, slope, further=index > first)
                for name, gradient in zip((weight, bias), found, strict=True):
                    into[name] = into[name].copy_(gradient) if name in into else gradient
            elif pair is not None:
                into[weight] = torch.mm(slope.t(), x, out=into.get(weight))
                into[bias] = torch.sum(slope, 0, out=into.get(bias))
                slope = slope.mm(pair[0]) if index > first else slope
            elif isinstance(layer, nn.ReLU):
                slope = torch.ops.aten.threshold_backward(slope, seen[index + 1], 0)
            else:
                slope = _channels_last(slope.reshape(x.shape))


def _channels_last(slope: Tensor) -> Tensor:
    """Convolutions, and what is before them, are several times as fast on images that lie channels last."""
    return slope.contiguous(memory_format=torch.channels_last) if slope.dim() == 4 else slope


def _forward(layer: nn.Module, pair: Pair | None, x: Tensor) -> Tensor:
    if pair is None:
        return x.relu_() if isinstance(layer, nn.ReLU) else x.flatten(1)
    weight, bias = pair
    if isinstance(layer, nn.Conv2d):
        return torch.conv2d(x, weight, bias, layer.stride, 0, layer.dilation, layer.groups)
    return torch.addmm(bias, x, weight.t())


def _convolved_back(layer: nn.Conv2d, weight: Tensor, x: Tensor, slope: Tensor, *, further: bool) -> list[Tensor]:
    """Slopes in `x` (only if `further`), weight and bias."""
    return list(
        torch.ops.aten.convolution_backward(
            slope,
            x,
            weight,
            [layer.out_channels],
            layer.stride,
            (0, 0),
            layer.dilation,
            False,  # not transposed
            (0, 0),
            layer.groups,
            (further, True, True),
        )
    )
