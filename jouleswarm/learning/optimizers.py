"""Optimizers by PyTorch's own fused kernels, without what surrounds them there.

The first optimizer of `torch.optim` that is made loads PyTorch's compiler: 800 modules, a second or two of every
process that learns, for nothing that is used here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import torch
from torch import Tensor
from torch.optim.adam import adam
from torch.optim.sgd import sgd


class Sgd:
    """Steps of -lr x gradient, as torch.optim.SGD(fused=True); a parameter's gradient is in `grad`."""

    def __init__(self, parameters: Iterable[Tensor], lr: float) -> None:
        self._parameters, self._lr = list(parameters), lr
        self.state: defaultdict[Tensor, dict[str, Tensor]] = defaultdict(dict)
        """Nothing is kept of any."""

    @torch.no_grad()
    def step(self) -> None:
        """Move all parameters that have a gradient."""
        parameters, gradients = _with_gradients(self._parameters)
        sgd(
            parameters,
            gradients,
            [None] * len(parameters),
            fused=True,
            weight_decay=0.0,
            momentum=0.0,
            lr=self._lr,
            dampening=0.0,
            nesterov=False,
            maximize=False,
        )


class Adam:
    """Kingma and Ba (2015), as torch.optim.Adam(fused=True), moments under the same names."""

    def __init__(self, parameters: Iterable[Tensor], lr: float, eps: float = 1e-8) -> None:
        self._parameters, self._lr, self._eps = list(parameters), lr, eps
        self.state: defaultdict[Tensor, dict[str, Tensor]] = defaultdict(dict)
        """Parameter -> step (float32, no dimensions), exp_avg and exp_avg_sq (as it); empty before a step."""

    @torch.no_grad()
    def step(self) -> None:
        """Move all parameters that have a gradient."""
        parameters, gradients = _with_gradients(self._parameters)
        states = [self.state[parameter] for parameter in parameters]
        for parameter, state in zip(parameters, states, strict=True):
            if not state:
                state["step"] = torch.zeros((), device=parameter.device)
                state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(parameter), torch.zeros_like(parameter)
        adam(
            parameters,
            gradients,
            [state["exp_avg"] for state in states],
            [state["exp_avg_sq"] for state in states],
            [],
            [state["step"] for state in states],
            fused=True,
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=self._lr,
            weight_decay=0.0,
            eps=self._eps,
            maximize=False,
        )


def _with_gradients(parameters: Iterable[Tensor]) -> tuple[list[Tensor], list[Tensor]]:
    found = [(parameter, parameter.grad) for parameter in parameters if parameter.grad is not None]
    return [parameter for parameter, _ in found], [gradient for _, gradient in found]
