"""Between the two halves of a run that a fault has ended: what it has left is gone on with, or refused, by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from jouleswarm.chaos.plan import FAILED, Fault
from jouleswarm.common.disk.trouble import NO_SPACE
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.runs.directory import STATE

ENDED_BY_AN_ERROR = ("disk full",)
INTERRUPTED = ("run interrupted", "state lost")
"""Kinds that end the run; it is gone on with then."""

_ASIDE = "aside"


def is_due_to(fault: Fault, end: BaseException) -> bool:
    """Whether a run's end is what the fault was to bring about."""
    return isinstance(end, RunError if fault.kind in ENDED_BY_AN_ERROR else KeyboardInterrupt)


def between(fault: Fault, end: BaseException, path: Path, resume: Callable[[], object]) -> None:
    """Look at how the run has ended; a state that is lost must be missed, and is put back. The fault's note says it."""
    if fault.kind == "disk full":
        fault.note = NO_SPACE if NO_SPACE in str(end) else f"{FAILED}told: {end}"
    elif fault.kind == "state lost":
        lost, aside = path / STATE / fault.target, path / _ASIDE
        lost.rename(aside)
        fault.note = _refusal(f"{STATE}/{fault.target}", resume)
        if not lost.exists():
            aside.rename(lost)


def _refusal(name: str, resume: Callable[[], object]) -> str:
    try:
        resume()
    except ConfigurationError as error:
        return "refused" if name in str(error) else f"{FAILED}named: {error}"
    return f"{FAILED}refused"
