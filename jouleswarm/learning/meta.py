"""MAML, eqs. (3)-(5), and its relatives as pure functions on dictionaries of parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.func import functional_call, grad

from jouleswarm.learning.dqn import td_loss, td_target
from jouleswarm.learning.qnetwork import QNetwork
from jouleswarm.learning.replay import Batch

Params = dict[str, Tensor]
S = TypeVar("S")
"""What one loss is of: a batch, or one of each of a task's robots."""

_TINY = 1e-6  # as torch.nn.utils.clip_grad_norm_


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


Loss = Callable[[Params, S], Tensor]


def make_loss(model: nn.Module, target: Params, discount: float, *, double: bool) -> Loss[TensorBatch]:
    """L_k(W | batch) of eq. (7) with the task's target network `target`; no gradient flows through targets."""

    def loss(params: Params, batch: TensorBatch) -> Tensor:
        next_q_target = functional_call(model, target, (batch.next_frames,)).detach()
        next_q = functional_call(model, _detached(params), (batch.next_frames,)) if double else next_q_target
        goal = td_target(batch.rewards, batch.terminated, next_q, next_q_target, discount, double=double)
        return td_loss(functional_call(model, params, (batch.frames,)), batch.actions, goal.detach())

    return loss


def adapt(
    params: Params,
    support: Sequence[S],
    loss: Loss[S],
    inner_lr: float,
    clip: float = math.inf,
    inner: Collection[str] | None = None,
    *,
    differentiable: bool = True,
) -> Params:
    """Task adaptation phi of eq. (3): one SGD step of size mu a support batch. Differentiable in `params` if asked.

    Gradients longer than `clip` (2-norm over all parameters that adapt) are shortened to it, as the robots' are.
    `inner` names the parameters that adapt, all by default; the others stay (ANIL: the last layer only).
    """
    for batch in support:
        fixed, moving = params, {name: params[name] for name in (inner or params)}

        def partial_loss(part: Params, batch: S = batch, fixed: Params = fixed) -> Tensor:
            return loss({**fixed, **part}, batch)

        found = grad(partial_loss)(moving) if differentiable else plain_gradient(partial_loss, moving)
        gradient = clipped(found, clip)
        params = {**fixed, **{name: value - inner_lr * gradient[name] for name, value in moving.items()}}
    return params


def plain_gradient(loss: Callable[[Params], Tensor], params: Params) -> Params:
    """The gradient of `loss` at `params`, with nothing to differentiate through it: cheaper than torch.func.grad."""
    leaves = {name: value.detach().requires_grad_() for name, value in params.items()}
    return dict(zip(leaves, torch.autograd.grad(loss(leaves), list(leaves.values())), strict=True))


def clipped(gradient: Params, norm: float) -> Params:
    """A gradient no longer than `norm` (2-norm over all parameters); differentiable, the identity at exactly 0."""
    if math.isinf(norm):
        return gradient
    squared = torch.stack([(value**2).sum() for value in gradient.values()]).sum()
    # The root has no slope at 0. Nothing flows back through the branch that is not taken, and the other is the root's.
    moves = squared > 0
    length = torch.where(moves, squared, 1.0).sqrt()
    scale = torch.where(moves, (norm / (length + _TINY)).clamp(max=1.0), 1.0)
    return {name: value * scale for name, value in gradient.items()}


def query_loss(params: Params, query: Sequence[S], loss: Loss[S]) -> Tensor:
    """Mean loss over the query batches."""
    return torch.stack([loss(params, batch) for batch in query]).mean()


def meta_gradient(
    params: Params,
    support: Sequence[S],
    query: Sequence[S],
    loss: Loss[S],
    inner_lr: float,
    *,
    exact: bool,
    clip: float = math.inf,
    inner: Collection[str] | None = None,
) -> tuple[Params, Params]:
    """One task's gradient of eq. (4), and the adapted parameters phi.

    `exact` differentiates through the adaptation (eq. (5): Jacobian times gradient); otherwise the Jacobian is
    taken as the identity and the gradient is the one at phi.
    """
    if not exact:
        adapted = adapt(params, support, loss, inner_lr, clip, inner, differentiable=False)
        return plain_gradient(lambda at: query_loss(at, query, loss), adapted), adapted

    def through(start: Params) -> tuple[Tensor, Params]:
        adapted = adapt(start, support, loss, inner_lr, clip, inner)
        return query_loss(adapted, query, loss), adapted

    gradient, adapted = grad(through, has_aux=True)(params)
    return gradient, _detached(adapted)


def reptile_gradient(
    params: Params, batches: Sequence[S], loss: Loss[S], inner_lr: float, clip: float = math.inf
) -> tuple[Params, Params]:
    """Reptile's direction W - phi (Nichol et al. 2018), phi after one SGD step a batch, and phi."""
    adapted = adapt(params, batches, loss, inner_lr, clip, differentiable=False)
    return {name: value - adapted[name] for name, value in params.items()}, adapted


def _detached(params: Params) -> Params:
    return {name: value.detach() for name, value in params.items()}
