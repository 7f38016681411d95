"""beta of eq. (9) as the data center has measured it, from its rows."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import fmean

from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase


def measured_beta(rows: Iterable[RoundRow], method: str, *, exact: bool) -> float | None:
    """Cost of a gradient through a gradient over one of first order: 1 by definition for methods without any.

    None if it was not measured. `exact`: as the method says of itself.
    """
    mine = [row for row in rows if (row.arm, row.phase, row.agent) == (method, RowPhase.ML, 0)]
    if not (exact and mine):
        return 1.0
    found = [row.beta for row in mine if row.beta is not None]
    return fmean(found) if found else None
