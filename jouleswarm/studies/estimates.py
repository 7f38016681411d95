"""The only statistics of the studies: a mean over seeds and its 95% interval."""

from __future__ import annotations

import math
from collections.abc import Iterable
from statistics import fmean, stdev
from typing import NamedTuple

from scipy.stats import t as student

from jouleswarm.common.errors import StudyError

_CONFIDENCE = 0.95
FEW_SEEDS = 3
"""Of so many seeds or fewer a drawing has each one's value: their interval says little but that there are few."""


class Estimate(NamedTuple):
    """A mean over `n` seeds; the 95% interval is mean - ci95 .. mean + ci95, not known of one seed."""

    mean: float
    ci95: float | None
    n: int
    singles: tuple[float, ...] = ()
    """Each seed's value, of two or three; of more the interval is drawn, of one neither."""

    @property
    def drawn_ci95(self) -> float:
        """Half width of the interval as drawings have it; 0: none."""
        return 0.0 if self.ci95 is None or self.singles else self.ci95

    def scaled(self, factor: float) -> Estimate:
        """The same in another unit."""
        singles = tuple(each * factor for each in self.singles)
        return Estimate(self.mean * factor, None if self.ci95 is None else self.ci95 * factor, self.n, singles)


def estimate(values: Iterable[float]) -> Estimate:
    """Mean and half width t(0.975, n - 1) s / sqrt(n) of Student's 95% interval, s the sample's deviation.

    Raises:
        StudyError: no value at all.
    """
    held = list(values)
    if not held:
        raise StudyError("a mean of no values was asked for; expected one seed or more")
    if len(held) < 2:
        return Estimate(held[0], None, 1)
    quantile = float(student.ppf((1 + _CONFIDENCE) / 2, len(held) - 1))
    half, singles = quantile * stdev(held) / math.sqrt(len(held)), tuple(held) if len(held) <= FEW_SEEDS else ()
    return Estimate(fmean(held), half, len(held), singles)
