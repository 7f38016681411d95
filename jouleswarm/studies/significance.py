"""Ratios of paired values over seeds with intervals, and whether two arms differ at all. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

_DRAWS = 2000


class Between(NamedTuple):
    """A value and its interval of 95%; infinite where nothing stands below the line."""

    value: float
    low: float | None
    high: float | None
    """None of one seed."""


class Ratios(NamedTuple):
    """What stands above over what stands below, seed by seed."""

    of_means: Between
    """The mean over seeds above by that below: what a bill of many deployments comes to."""
    mean: Between
    """The mean over seeds of each one's ratio."""


def ratios(above: Sequence[float], below: Sequence[float]) -> Ratios:
    """Both ratios; the intervals are the middle 95% over pairs drawn again with replacement (Efron 1979).

    Args:
        above: [seeds].
        below: [seeds] of the same seeds in the same order, 0 or more.
    """
    pairs = np.array([above, below], dtype=float)  # [2, seeds]
    drawn = np.random.default_rng(1).integers(pairs.shape[1], size=(_DRAWS, pairs.shape[1]))
    again = pairs[:, drawn]  # [2, draws, seeds]
    return Ratios(
        _between(_over(*pairs.mean(axis=1)), _over(*again.mean(axis=2)), len(above)),
        _between(_over(*pairs).mean(), _over(*again).mean(axis=1), len(above)),
    )


def _over(above: NDArray[np.float64], below: NDArray[np.float64]) -> NDArray[np.float64]:
    """Element by element; nothing over nothing is 1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.divide(above, below)
    return np.where(np.isnan(found), 1.0, found)


def _between(value: NDArray[np.float64], drawn: NDArray[np.float64], seeds: int) -> Between:
    if seeds < 2:
        return Between(float(value), None, None)
    low, high = np.quantile(drawn, [0.025, 0.975], method="inverted_cdf")  # between two infinities is nothing
    return Between(float(value), float(low), float(high))


def paired_p(one: Sequence[float], other: Sequence[float]) -> float | None:
    """Two-sided p of Wilcoxon's signed-rank test over pairs, exact with ties too; None of fewer than 2 pairs.

    Pairs that do not differ are left out (Wilcoxon's own rule); where none does p is 1. `scipy.stats.wilcoxon` is
    exact without ties alone, and rounds are whole numbers: here all 2^n ways to set signs are counted, rank by rank.
    """
    if len(one) < 2:
        return None
    apart = np.subtract(one, other)
    apart = apart[apart != 0]
    ranks = np.rint(2 * rankdata(np.abs(apart))).astype(int)  # twice the midranks, which are whole
    ways = np.ones(1)
    for rank in ranks:  # ways[s]: share of the ways in which the positive ranks so far sum up to s
        ways = np.convolve(ways, np.bincount([0, rank], minlength=rank + 1) / 2)
    positive = int(ranks[apart > 0].sum())
    tail = min(float(ways[: positive + 1].sum()), float(ways[positive:].sum()))
    return min(1.0, 2 * tail)


def holm(values: Sequence[float | None]) -> list[float | None]:
    """p values of one family by Holm (1979): the smallest of m times m, the next times m - 1, and never falling."""
    known = sorted((value, place) for place, value in enumerate(values) if value is not None and not math.isnan(value))
    found: list[float | None] = [None] * len(values)
    least = 0.0
    for rank, (value, place) in enumerate(known):
        found[place] = least = max(least, min(1.0, (len(known) - rank) * value))
    return found
