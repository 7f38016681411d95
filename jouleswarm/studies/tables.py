"""Cells of tables over seeds."""

from __future__ import annotations

from jouleswarm.report.table import number
from jouleswarm.studies.estimates import Estimate
from jouleswarm.studies.significance import Between


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


def at_least(text: str, censored: int) -> str:
    """`≥ 12.3 ± 4.5` where runs among those were cut off at max_rounds: what they count is the least it can be."""
    return f"≥ {text}" if censored and text != "-" else text


def between_text(found: Between) -> str:
    """`2.40 (1.92 to 3.01)`; without the interval of one seed."""
    if found.low is None or found.high is None:
        return number(found.value)
    return f"{number(found.value)} ({number(found.low)} to {number(found.high)})"
