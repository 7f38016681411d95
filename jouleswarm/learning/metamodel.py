"""The meta-model's parameters: one network for all tasks, or one trunk with a last layer for each training task."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from jouleswarm.learning.heads import head_key, head_of
from jouleswarm.learning.meta import Params


class MetaModel:
    """W_tau as leaf tensors with gradients; `tasks` have heads of their own, no task means one head for all."""

    def __init__(self, model: nn.Sequential, tasks: tuple[int, ...]) -> None:
        self._names, self.tasks = tuple(name for name, _ in model.named_parameters()), tasks
        own = head_of(model) if tasks else ()
        start = {name: value.detach() for name, value in model.named_parameters()}
        self._shared = {name: _leaf(start[name]) for name in self._names if name not in own}
        self._heads = {task: {name: _leaf(start[name]) for name in own} for task in tasks}

    def params(self, task: int) -> Params:
        """A training task's parameters by the network's names, detached."""
        found = self._shared | self._heads.get(task, {})
        return {name: found[name].detach() for name in self._names}

    def named(self) -> Iterator[tuple[str, Tensor]]:
        """Every leaf under a name of its own, in a stable order."""
        yield from self._shared.items()
        for task, head in self._heads.items():
            for name, value in head.items():
                yield head_key(task, name), value

    def zero_gradients(self) -> None:
        """Before the tasks' gradients are added up."""
        for _, leaf in self.named():
            leaf.grad = torch.zeros_like(leaf)

    def add_gradient(self, task: int, gradient: Params, share: float) -> None:
        """Add `share` of a task's gradient: to the trunk, and to the task's own head where it has one."""
        found = self._shared | self._heads.get(task, {})
        for name, value in gradient.items():
            grad = found[name].grad
            assert grad is not None
            grad.add_(value, alpha=share)

    def weights(self) -> dict[str, npt.NDArray[np.float32]]:
        """As it goes on the wire: the network (its last layer the heads' mean), then each head under its key."""
        mean = {
            name: torch.stack([head[name].detach() for head in self._heads.values()]).mean(dim=0)
            for name in next(iter(self._heads.values()), {})
        }
        network = {name: mean[name] if name in mean else self._shared[name].detach() for name in self._names}
        heads = {head_key(task, name): value for task, head in self._heads.items() for name, value in head.items()}
        return {
            name: np.array(value.detach().cpu().numpy(), order="C", copy=True)
            for name, value in (network | heads).items()
        }


def _leaf(value: Tensor) -> Tensor:
    return value.clone(memory_format=torch.preserve_format).requires_grad_()
