"""A module's parameters and their gradients, each end to end in one buffer: what is done to all is one operation."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor, nn

_APART = 16
"""Floats: parameters begin at multiples of 64 bytes, as PyTorch's own do; products may round otherwise elsewhere."""


class Flat:
    """Parameters of a module as views, with the strides that they had, of `values`; of their gradients if asked.

    What lies between the views is 0 and stays so.
    """

    def __init__(self, module: nn.Module, *, gradients: bool = False) -> None:
        """`module`: its parameters are float32 and on the CPU; they are moved, and keep their values."""
        self._places: list[tuple[torch.Size, tuple[int, ...], int]] = []
        parameters, end = list(module.parameters()), 0
        for parameter in parameters:
            dense = torch.empty_like(parameter)  # a builder of the user's may have left gaps
            self._places.append((parameter.shape, dense.stride(), end))
            end += -(-parameter.numel() // _APART) * _APART
        self.values = torch.zeros(end)
        for parameter, view in zip(parameters, self.views(self.values), strict=True):
            parameter.data = view.copy_(parameter.detach())
        if gradients:
            self.values.grad = torch.zeros(end)
            for parameter, view in zip(parameters, self.views(self.values.grad), strict=True):
                parameter.grad = view if parameter.requires_grad else None

    def views(self, buffer: Tensor) -> Iterator[Tensor]:
        """Of a buffer that is laid out as `values` is, the part of each parameter, in the module's order."""
        for shape, strides, start in self._places:
            yield buffer.as_strided(shape, strides, start)

    def clip(self, norm: float) -> None:
        """Shorten the gradient to `norm` (2-norm), as torch.nn.utils.clip_grad_norm_ does."""
        gradient = self.values.grad
        assert gradient is not None
        gradient.mul_((norm / (torch.linalg.vector_norm(gradient) + 1e-6)).clamp_(max=1.0))
