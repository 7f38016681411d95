"""The only statistics of the studies: a mean over seeds and its 95% interval."""

from __future__ import annotations

import math
from collections.abc import Iterable
from statistics import fmean, stdev
from typing import NamedTuple

from scipy.stats import t as student

from jouleswarm.common.errors import StudyError

_CONFIDENCE = 0.95


class Estimate(NamedTuple):
    """A mean over `n` seeds; the 95% interval is mean - ci95 .. mean + ci95, not known of one seed."""

    mean: float
    ci95: float | None
    n: int

    def scaled(self, factor: float) -> Estimate:
        """The same in another unit."""
        return Estimate(self.mean * factor, None if self.ci95 is None else self.ci95 * factor, self.n)


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
    return Estimate(fmean(held), quantile * stdev(held) / math.sqrt(len(held)), len(held))
