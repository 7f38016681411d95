"""Deep Q-learning, eq. (7), as pure functions on tensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional


def td_target(
    reward: Tensor, terminated: Tensor, next_q: Tensor, next_q_target: Tensor, discount: float, *, double: bool
) -> Tensor:
    """r + nu * q~(x', y*), float32 [batch]; nothing is added where the episode terminated.

    `next_q` and `next_q_target` are the online and the target network's values of the next observation,
    [batch, actions]. With `double` (van Hasselt et al. 2016) the online network chooses y*, else the target.
    """
    chooser = next_q if double else next_q_target
    best = chooser.argmax(dim=1, keepdim=True)
    value = next_q_target.gather(1, best).squeeze(1)
    return reward + discount * value * (1.0 - terminated)


def td_loss(q: Tensor, action: Tensor, target: Tensor) -> Tensor:
    """Mean Huber loss (delta = 1) between Q of the taken actions and their targets; `q` is [batch, actions]."""
    return functional.smooth_l1_loss(q.gather(1, action.unsqueeze(1)).squeeze(1), target)


def td_slope(q: Tensor, action: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
    """`td_loss`, and its slope in `q`, [batch, actions]."""
    taken = action.unsqueeze(1)
    error = q.gather(1, taken).squeeze(1) - target
    loss = functional.smooth_l1_loss(error, torch.zeros_like(error))
    slope = error.clamp(-1.0, 1.0).div_(len(error))
    return loss, torch.zeros_like(q).scatter_(1, taken, slope.unsqueeze(1))


def ran_away(values: Sequence[float], rewards: Sequence[float], discount: float) -> float | None:
    """Mean |Q| of an episode's actions where it is more than ten times what its rewards could ever add up to.

    |Q| is at most max |r| / (1 - nu) for any policy, so that values beyond that are no estimate of a return. A network
    may know of rewards that this episode did not meet, hence the ten times, and a reward of 1 at least.

    Args:
        values: Q of each action that was taken.
        rewards: of each.
        discount: nu; with 1 there is no such bound.

    Returns:
        None where the values may be right.
    """
    if not values or discount >= 1:
        return None
    mean = sum(map(abs, values)) / len(values)
    return mean if mean > 10 * return_limit(rewards, discount) else None


def return_limit(rewards: Sequence[float], discount: float) -> float:
    """max(|r|, 1) / (1 - nu): no discounted return of rewards as large as these is beyond it."""
    return max(1.0, *map(abs, rewards)) / (1 - discount)


def epsilon_greedy(q: Tensor, epsilon: float, rng: np.random.Generator) -> int:
    """A random action with probability `epsilon`, else the best of `q` [actions]."""
    if rng.random() < epsilon:
        return int(rng.integers(q.numel()))
    return int(q.argmax())


def polyak_update(target: Sequence[Tensor], online: Sequence[Tensor], rate: float) -> None:
    """target += rate * (online - target), in place (rate 1 copies)."""
    with torch.no_grad():
        torch._foreach_lerp_(tuple(target), tuple(online), rate)
