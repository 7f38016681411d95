"""gCO2e by site over seeds, for tables beside joules; no column where no site's carbon intensity is set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from jouleswarm.common.scenario.sections import Energy
from jouleswarm.energy.carbon import carbon, has_carbon
from jouleswarm.studies.estimates import Estimate, estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import cost_of

_NAMES = ("datacenter_g", "robots_g", "total_g")
_HEADINGS = ("data center (gCO2e)", "robots (gCO2e)", "gCO2e")


def carbon_columns(energy: Energy) -> tuple[str, ...]:
    """Names of the CSV columns: a mean and its interval for each site and for both."""
    return tuple(column for name in _NAMES for column in (name, f"{name}_ci95")) if has_carbon(energy) else ()


def carbon_headings(energy: Energy) -> tuple[str, ...]:
    """Headings for readers."""
    return _HEADINGS if has_carbon(energy) else ()


def carbon_estimates(runs: Iterable[Sequence[Fact]], energy: Energy) -> tuple[Estimate | None, ...]:
    """Grams at the data center, at the robots, and at both; literal prices.

    Args:
        runs: each seed's facts of one arm.
        energy: constants, and the intensity at each site. None stands for a site whose intensity is not known.
    """
    if not has_carbon(energy):
        return ()
    grams = [carbon(cost_of(run, energy), energy) for run in runs]
    return tuple(_known([getattr(each, name) for each in grams]) for name in _NAMES)


def _known(values: Sequence[float | None]) -> Estimate | None:
    held = [value for value in values if value is not None]
    return estimate(held) if held else None
