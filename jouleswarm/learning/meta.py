"""MAML, eqs. (3)-(5), and its relatives as pure functions on dictionaries of parameters.

The inner step size mu is one number, or one that is learned for each layer (Meta-SGD, Li et al. 2017, there one for
each weight). What is learned is log mu, so that mu stays above 0.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TypeVar

import torch
from torch import Tensor

from jouleswarm.learning.passes import Params
from jouleswarm.learning.task_loss import ByHand, Loss, added

Rate = float | Params
"""mu; or log mu of each layer, float32 without dimensions, by `rate_key`."""
S = TypeVar("S")
"""What one loss is of."""
_TINY = 1e-6  # as torch.nn.utils.clip_grad_norm_


def rate_key(name: str) -> str:
    """What log mu of a parameter's layer is called; weight and bias of a layer have one."""
    return f"log_mu/{name.rpartition('.')[0]}"


def adapt(
    params: Params,
    support: Sequence[S],
    loss: Loss[S],
    inner_lr: Rate,
    clip: float = math.inf,
    inner: Collection[str] | None = None,
    *,
    differentiable: bool = True,
) -> Params:
    """Task adaptation phi of eq. (3): one SGD step of size mu a support batch. Differentiable in `params`, and in log
    mu where that is learned, if asked.

    Gradients longer than `clip` (2-norm over all parameters that adapt) are shortened to it, as the robots' are.
    `inner` names the parameters that adapt, all by default; the others stay (ANIL: the last layer only).
    """
    mu = {name: _step_size(inner_lr, name) for name in (inner or params)}
    if differentiable:  # of plain numbers there is no slope to take
        params = {name: each if each.requires_grad else each.detach().requires_grad_() for name, each in params.items()}
    for batch in support:
        moving = {name: params[name] for name in mu}
        found = _slope(loss(params, batch), moving) if differentiable else plain_gradient(loss, params, [batch], mu)
        gradient = clipped(found, clip)
        params = params | {name: value - mu[name] * gradient[name] for name, value in moving.items()}
    return params


def _step_size(inner_lr: Rate, name: str) -> float | Tensor:
    return inner_lr[rate_key(name)].exp() if isinstance(inner_lr, dict) else inner_lr


def plain_gradient(loss: Loss[S], params: Params, samples: Sequence[S], of: Collection[str] | None = None) -> Params:
    """The gradient of the mean loss of `samples` at `params`, with nothing to differentiate through it.

    `of`: of these parameters, by default of all.
    """
    of = params if of is None else of
    if isinstance(loss, ByHand):
        share = 1 / len(samples)
        found = added([loss.gradient(params, each, share, of) for each in reversed(samples)])  # autograd's order
        return {name: found[name] for name in of}
    leaves = _leaves({name: params[name] for name in of})
    return _slope(query_loss(params | leaves, samples, loss), leaves, further=False)


def _slope(value: Tensor, params: Params, *, further: bool = True) -> Params:
    """Of a value in the parameters that it was computed from, 0 in those that it was not; `further`: differentiable."""
    # Not by torch.func.grad, which gives the same and loads PyTorch's compiler for it (see `optimizers`).
    found = torch.autograd.grad(value, list(params.values()), create_graph=further, materialize_grads=True)
    return dict(zip(params, found, strict=True))


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
    inner_lr: Rate,
    *,
    exact: bool,
    clip: float = math.inf,
    inner: Collection[str] | None = None,
) -> tuple[Params, Params]:
    """One task's gradient of eq. (4), and the adapted parameters phi.

    `exact` differentiates through the adaptation (eq. (5): Jacobian times gradient); otherwise the Jacobian is
    taken as the identity and the gradient is the one at phi. Where mu is learned the gradient of each log mu is there
    too, under its key: exact, or with the inner gradients taken as constants.
    """
    if not exact:
        adapted = adapt(params, support, loss, inner_lr, clip, inner, differentiable=False)
        gradient = plain_gradient(loss, adapted, query)
        rates = _first_order_of_rates(inner_lr, gradient, params, adapted) if isinstance(inner_lr, dict) else {}
        return gradient | rates, adapted

    start, rate = _leaves(params), _leaves(inner_lr) if isinstance(inner_lr, dict) else inner_lr
    adapted = adapt(start, support, loss, rate, clip, inner)
    leaves = start | rate if isinstance(rate, dict) else start
    return _slope(query_loss(adapted, query, loss), leaves, further=False), _detached(adapted)


def _first_order_of_rates(rates: Params, gradient: Params, params: Params, adapted: Params) -> Params:
    """d/d log mu = -mu <g_query, sum of g_support> of a layer, which is <g_query, phi - W>."""
    found = {key: torch.zeros_like(value) for key, value in rates.items()}
    for name, value in gradient.items():
        found[rate_key(name)] += (value * (adapted[name] - params[name])).sum()
    return found


def reptile_gradient(
    params: Params, batches: Sequence[S], loss: Loss[S], inner_lr: Rate, clip: float = math.inf
) -> tuple[Params, Params]:
    """Reptile's direction W - phi (Nichol et al. 2018), phi after one SGD step a batch, and phi."""
    adapted = adapt(params, batches, loss, inner_lr, clip, differentiable=False)
    return {name: value - adapted[name] for name, value in params.items()}, adapted


def _leaves(params: Params) -> Params:
    return {name: value.detach().requires_grad_() for name, value in params.items()}


def _detached(params: Params) -> Params:
    return {name: value.detach() for name, value in params.items()}
