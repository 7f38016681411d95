"""The meta-model's parameters: one network for all tasks, or one trunk with a last layer for each training task."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from jouleswarm.learning.heads import head_key, head_of
from jouleswarm.learning.meta import rate_key
from jouleswarm.learning.passes import Params


class MetaModel:
    """W_tau as leaf tensors with gradients; `tasks` have heads of their own, no task means one head for all.

    With `inner_lr` log mu of each layer is learned beside it, from there. It stays here: robots adapt by their own
    optimizer, so it does not go on the wire.
    """

    def __init__(self, model: nn.Sequential, tasks: tuple[int, ...], inner_lr: float | None = None) -> None:
        self._names, self.tasks = tuple(name for name, _ in model.named_parameters()), tasks
        own = head_of(model) if tasks else ()
        start = {name: value.detach() for name, value in model.named_parameters()}
        self._shared = {name: _leaf(start[name]) for name in self._names if name not in own}
        self._heads = {task: {name: _leaf(start[name]) for name in own} for task in tasks}
        self.rates: Params = {}
        if inner_lr is not None:
            log_mu = start[self._names[0]].new_tensor(math.log(inner_lr))
            self.rates = {key: _leaf(log_mu) for key in dict.fromkeys(map(rate_key, self._names))}

    def params(self, task: int, *, unseen: bool = False) -> Params:
        """A training task's parameters by the network's names, detached.

        `unseen`: as if it had no head of its own, with the mean of the other tasks' heads, from where robots of unseen
        tasks start.
        """
        head = self._mean(self._others(task)) if unseen else self._heads.get(task, {})
        found = self._shared | head
        return {name: found[name].detach() for name in self._names}

    def named(self) -> Iterator[tuple[str, Tensor]]:
        """Every leaf of the network and its heads under a name of its own, in a stable order."""
        yield from self._shared.items()
        for task, head in self._heads.items():
            for name, value in head.items():
                yield head_key(task, name), value

    def zero_gradients(self) -> None:
        """Before the tasks' gradients are added up."""
        for leaf in (*dict(self.named()).values(), *self.rates.values()):
            leaf.grad = torch.zeros_like(leaf)

    def add_gradient(self, task: int, gradient: Params, share: float, *, unseen: bool = False) -> None:
        """Add `share` of a task's gradient: to the trunk, to learned rates, and to the task's own head if it has one.

        `unseen`: it was taken at the mean of the n - 1 other heads, of which each gets its 1 / (n - 1).
        """
        heads = self._others(task) if unseen else [self._heads.get(task, {})]
        for name, value in gradient.items():
            if name in heads[0]:
                for head in heads:
                    _add(head[name], value, share / len(heads))
            else:
                _add(self.rates[name] if name in self.rates else self._shared[name], value, share)

    def weights(self) -> dict[str, npt.NDArray[np.float32]]:
        """As it goes on the wire: the network (its last layer the heads' mean), then each head under its key."""
        mean = self._mean(list(self._heads.values()))
        network = {name: mean[name] if name in mean else self._shared[name].detach() for name in self._names}
        heads = {head_key(task, name): value for task, head in self._heads.items() for name, value in head.items()}
        return {
            name: np.array(value.detach().cpu().numpy(), order="C", copy=True)
            for name, value in (network | heads).items()
        }

    def _others(self, task: int) -> list[Params]:
        return [head for other, head in self._heads.items() if other != task]

    def _mean(self, heads: list[Params]) -> Params:
        return {
            name: torch.stack([head[name].detach() for head in heads]).mean(dim=0)
            for name in (heads[0] if heads else ())
        }


def _add(leaf: Tensor, gradient: Tensor, share: float) -> None:
    assert leaf.grad is not None
    leaf.grad.add_(gradient, alpha=share)


def _leaf(value: Tensor) -> Tensor:
    return value.clone(memory_format=torch.preserve_format).requires_grad_()
