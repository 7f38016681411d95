"""Several models into one, as pure functions: consensus over the sidelinks, eq. (6), and the weighed average."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from jouleswarm.common.wire.types import Array, Weights


def mixing_weights(samples: Mapping[int, int]) -> dict[int, float]:
    """sigma_kh = |E_h| / sum over neighbours j of |E_j|, for each neighbour h; they sum to 1."""
    total = sum(samples.values())
    return {agent: count / total for agent, count in samples.items()}


def default_step(neighbours: int, share: float = 1.0) -> float:
    """1/(N+1): with one neighbour the two meet half way, where the literal step 1 would swap them.

    `share`: of the entries that a message brings. An entry is mixed 1/share times before it is heard of again;
    at the full step the robots would go past each other by ever more.
    """
    return share / (neighbours + 1)


def mix(
    own: Mapping[str, Array],
    others: Mapping[int, Mapping[str, Array]],
    sigma: Mapping[int, float],
    step: float,
    told: Mapping[str, Array] | None = None,
) -> Weights:
    """W_k + step * sum_h sigma_kh (W_h - W_k), all neighbours at once; float32, nothing changed in place.

    With a lossy codec neighbours hold `told` of this robot, and it theirs (Koloskova et al. 2019): then
    W_k + step * sum_h sigma_kh (told_h - told_k), which leaves W_k its own precision.
    Neighbours are added in the order of their ids, so that the sum is the same whoever came first.
    """
    known = own if told is None else told
    return {
        name: tensor
        + np.float32(step)
        * sum(
            (np.float32(sigma[agent]) * (others[agent][name] - known[name]) for agent in sorted(others)),
            start=np.zeros_like(tensor),
        )
        for name, tensor in own.items()
    }


def weighted_average(models: Sequence[Mapping[str, Array]], samples: Sequence[int]) -> Weights:
    """sum_k |E_k| W_k / sum_k |E_k|, float32, added up in the order given."""
    shares = [np.float32(count / sum(samples)) for count in samples]
    return {
        name: sum(
            (share * model[name] for share, model in zip(shares, models, strict=True)), np.zeros_like(models[0][name])
        )
        for name in models[0]
    }
