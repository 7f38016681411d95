"""Cells of tables over seeds."""

from __future__ import annotations

from jouleswarm.report.table import number
from jouleswarm.studies.estimates import Estimate


def spread(found: Estimate | None) -> tuple[float | None, float | None]:
    """Mean and interval as two CSV cells, both empty where there is no estimate."""
    return (None, None) if found is None else (found.mean, found.ci95)


def estimate_text(found: Estimate | None, factor: float = 1.0) -> str:
    """`12.3 ± 4.5` in units of `factor`; without the interval of one seed; "-" for None."""
    if found is None:
        return "-"
    mean = number(found.mean / factor)
    return mean if found.ci95 is None else f"{mean} ± {number(found.ci95 / factor)}"


def failures_text(failures: int, trials: int) -> str:
    """How many of the tasks' trials were not learned."""
    return f"{failures} of {trials}"
