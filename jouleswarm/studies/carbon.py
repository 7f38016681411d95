"""gCO2e by site over seeds, for tables beside joules; no column where no site's carbon intensity is set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.carbon import Carbon, at_sites, carbon, has_carbon
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList
from jouleswarm.studies.estimates import Estimate, estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import priced

_NAMES = ("datacenter_g", "robots_g", "total_g")
_HEADINGS = ("data center (gCO2e)", "robots (gCO2e)", "gCO2e")


def carbon_columns(energy: Energy) -> tuple[str, ...]:
    """Names of the CSV columns: a mean and its interval for each site and for both."""
    return tuple(column for name in _NAMES for column in (name, f"{name}_ci95")) if has_carbon(energy) else ()


def carbon_headings(energy: Energy) -> tuple[str, ...]:
    """Headings for readers."""
    return _HEADINGS if has_carbon(energy) else ()


def carbon_estimates(
    runs: Iterable[Sequence[Fact]], energy: Energy, prices: PriceList = literal
) -> tuple[Estimate | None, ...]:
    """Grams at the data center, at the robots, and at both.

    Args:
        runs: each seed's facts of one arm.
        energy: constants, and the intensity at each site. None stands for a site whose intensity is not known.
        prices: which price list; one that tells no sites has no grams.
    """
    if not has_carbon(energy):
        return ()
    bills = [priced(run, energy, prices) for run in runs]
    grams = [carbon(bill, at_sites(energy)) if bill else Carbon(None, None) for bill in bills]
    return tuple(_known([getattr(each, name) for each in grams]) for name in _NAMES)


def _known(values: Sequence[float | None]) -> Estimate | None:
    held = [value for value in values if value is not None]
    return estimate(held) if held else None
