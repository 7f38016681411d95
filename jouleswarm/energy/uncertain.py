"""Bills at constants that are not known exactly: draws of the constants, and what the bills then come to. Pure.

Draws are by Latin hypercube (McKay, Beckman, Conover 1979): each constant's range is cut into as many equal shares as
there are draws, and each share is hit once, so that means are far closer than by plain draws.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.uncertain import Uncertain

DRAWS = 2000


class Interval(NamedTuple):
    """A mean and the middle 95% of draws."""

    mean: float
    low: float
    high: float


def draw(energy: Energy, draws: int = DRAWS, seed: int = 1) -> Iterator[Energy]:
    """The constants, drawn so often; the same ones again and again where all are known exactly."""
    names = sorted(energy.uncertain)
    if not names:
        yield from (energy for _ in range(draws))
        return
    cube = qmc.LatinHypercube(len(names), rng=np.random.default_rng(seed)).random(draws)
    drawn = [quantile(energy.uncertain[name], cube[:, column]) for column, name in enumerate(names)]
    for values in np.transpose(drawn):
        yield energy.model_copy(update=dict(zip(names, map(float, values), strict=True)))


def quantile(spread: Uncertain, share: NDArray[np.float64]) -> NDArray[np.float64]:
    """[n] the values below which a share of the distribution lies, for shares in [0, 1)."""
    low, high = spread.low, spread.high
    if spread.shape == "loguniform":
        return np.asarray(low * (high / low) ** share)
    if spread.likely is None or low == high:
        return np.asarray(low + (high - low) * share)
    bend = (spread.likely - low) / (high - low)
    rising = low + np.sqrt(share * (high - low) * (spread.likely - low))
    falling = high - np.sqrt((1 - share) * (high - low) * (high - spread.likely))
    return np.where(share < bend, rising, falling)


def bills(prices: Mapping[str, Callable[[Energy], float]], drawn: list[Energy]) -> dict[str, NDArray[np.float64]]:
    """[draws] joules of each of `prices`, all at the same draws."""
    return {name: np.array([price(energy) for energy in drawn]) for name, price in prices.items()}


def interval(joules: NDArray[np.float64]) -> Interval:
    """Mean and middle 95%; the digits of a bill without draws where all are alike."""
    low, high = np.quantile(joules, [0.025, 0.975])
    mean = joules[0] if low == high == joules[0] else joules.mean()
    return Interval(float(mean), float(low), float(high))


def pays(mine: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Share of the draws in which one is cheaper than the other; a tie is half."""
    return float(((mine < other) + 0.5 * (mine == other)).mean())
