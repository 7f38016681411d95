"""beta of eq. (9) as the data center has measured it, from its rows."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import fmean

from jouleswarm.common.scenario.arms import EXACT_METHODS
from jouleswarm.common.wire.rows import RoundRow


def measured_beta(rows: Iterable[RoundRow], method: str) -> float | None:
    """Cost of a gradient through a gradient over one of first order: 1 by definition for methods without any.

    None if it was not measured.
    """
    mine = [row for row in rows if (row.arm, row.phase, row.agent) == (method, "maml", 0)]
    if method not in EXACT_METHODS or not mine:
        return 1.0
    found = [row.beta for row in mine if row.beta is not None]
    return fmean(found) if found else None
