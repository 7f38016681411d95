"""The loss of eq. (7) in the data center: of parameters that are given, with each task's own target network."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

import torch
from torch import Tensor
from torch.func import functional_call

from jouleswarm.learning.dqn import td_loss, td_slope, td_target
from jouleswarm.learning.passes import Params, Stack, is_plain
from jouleswarm.learning.qnetwork import QNetwork
from jouleswarm.learning.replay import Batch

S = TypeVar("S", contravariant=True)
"""What one loss is of: a batch, or one of each of a task's robots."""


class Loss(Protocol[S]):
    """Of parameters by their names and a sample, without dimensions."""

    def __call__(self, params: Params, sample: S, /) -> Tensor: ...


@runtime_checkable
class ByHand(Protocol[S]):
    """A loss that knows its gradient, where nothing is to be differentiated through that."""

    def gradient(self, params: Params, sample: S, share: float, of: Collection[str]) -> Params:
        """Of `share` times the loss, in the parameters `of`; others' may be there too."""


@dataclass(frozen=True)
class TensorBatch:
    """A replayed batch on the data center's device."""

    frames: Tensor  # float32 [batch, *observation]
    actions: Tensor  # int64 [batch]
    rewards: Tensor  # float32 [batch]
    next_frames: Tensor  # float32 [batch, *observation]
    terminated: Tensor  # float32 [batch]


def to_tensors(batch: Batch, model: QNetwork, device: torch.device) -> TensorBatch:
    """Move a replayed batch to `device`, as `model` takes it."""
    return TensorBatch(
        model.prepare(batch.frames, device),
        torch.from_numpy(batch.actions).to(device),
        torch.from_numpy(batch.rewards).to(device),
        model.prepare(batch.next_frames, device),
        torch.from_numpy(batch.terminated).to(device),
    )


def make_loss(model: torch.nn.Sequential, target: Params, discount: float, *, double: bool) -> Loss[TensorBatch]:
    """L_k(W | batch) of eq. (7) with the task's target network `target`; no gradient flows through targets.

    On the CPU it knows its gradient by hand (`ByHand`) where the network is a plain stack.
    """
    if is_plain(model) and all(value.is_cpu for value in target.values()):
        return PlainLoss(Stack(model), target, discount, double=double)
    return TaskLoss(lambda params, x: functional_call(model, params, (x,)), target, discount, double=double)


def sum_of(loss: Loss[TensorBatch]) -> Loss[Sequence[TensorBatch]]:
    """Of a batch of each of a task's robots k: the sum of L_k, eq. (1); by hand if `loss` is."""
    return PlainSum(loss) if isinstance(loss, PlainLoss) else TaskSum(loss)


class TaskSum:
    """See `sum_of`."""

    def __init__(self, loss: Loss[TensorBatch]) -> None:
        self._loss = loss

    def __call__(self, params: Params, sample: Sequence[TensorBatch]) -> Tensor:
        """Without dimensions."""
        return functools.reduce(operator.add, (self._loss(params, batch) for batch in sample))


class PlainSum(TaskSum):
    """By hand."""

    def __init__(self, loss: PlainLoss) -> None:
        super().__init__(loss)
        self._plain = loss

    def gradient(self, params: Params, sample: Sequence[TensorBatch], share: float, of: Collection[str]) -> Params:
        """See `ByHand`."""
        return added([self._plain.gradient(params, batch, share, of) for batch in reversed(sample)])  # autograd's order


def added(parts: Sequence[Params]) -> Params:
    """The sum of dictionaries with the same keys."""
    return {name: functools.reduce(operator.add, (each[name] for each in parts)) for name in parts[0]}


class TaskLoss:
    """See `make_loss`."""

    def __init__(
        self, function: Callable[[Params, Tensor], Tensor], target: Params, discount: float, *, double: bool
    ) -> None:
        """`function`: of parameters and observations, the network's values."""
        self._function, self._target = function, target
        self._discount, self._double = discount, double

    def __call__(self, params: Params, batch: TensorBatch) -> Tensor:
        """Mean over the batch, without dimensions."""
        return td_loss(self._function(params, batch.frames), batch.actions, self._goal(params, batch))

    @torch.no_grad()
    def _goal(self, params: Params, batch: TensorBatch) -> Tensor:
        of_target = self._function(self._target, batch.next_frames)
        next_q = self._function(params, batch.next_frames) if self._double else of_target
        return td_target(batch.rewards, batch.terminated, next_q, of_target, self._discount, double=self._double)


class PlainLoss(TaskLoss):
    """Of a plain stack."""

    def __init__(self, stack: Stack, target: Params, discount: float, *, double: bool) -> None:
        super().__init__(stack.differentiable, target, discount, double=double)
        self._stack = stack

    @torch.no_grad()
    def gradient(self, params: Params, batch: TensorBatch, share: float, of: Collection[str]) -> Params:
        """See `ByHand`."""
        pairs = self._stack.pairs(params)
        values, gradient = self._stack.there_and_back(pairs, batch.frames, len(batch.frames), of)
        _, slope = td_slope(values, batch.actions, self._goal(params, batch))
        found: Params = {}
        gradient(slope.mul_(share), found)
        return found
