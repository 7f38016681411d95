"""Where the sliders stand, and what the run costs there."""

from __future__ import annotations

import shlex
from collections.abc import Mapping

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.repricing import reprice
from jouleswarm.report.sliders import LINK_SLIDERS, SLIDERS, Slider

_BY_KEY = {each.key: each for each in (*SLIDERS, *LINK_SLIDERS)}
BOUNDS, STEP = (-1.0, 1.0), 0.05
"""Of a factor's position."""
CARBON_BOUNDS, CARBON_STEP = (0.0, 1000.0), 10.0


def position(slider: Slider, energy: Energy) -> float:
    """Where a slider stands at the run's own prices; an intensity that is not known stands at 0."""
    return 0.0 if slider.is_factor else min(_own(slider, energy) or 0.0, CARBON_BOUNDS[1])


def value(slider: Slider, at: float, energy: Energy) -> float | None:
    """What a position means, in the scenario's own unit, to four digits; the run's own where it was not moved."""
    if at == position(slider, energy):
        return _own(slider, energy)
    own = _own(slider, energy)
    if own is None and slider.follows:
        own = getattr(energy, slider.follows)
    return float(f"{own * 10**at:.4g}") if slider.is_factor and own is not None else at


def value_text(slider: Slider, at: float, energy: Energy) -> str:
    """The same as a reader sees it, as HTML: `200 kb/J`."""
    found = value(slider, at, energy)
    if found is None:
        return f"as {_BY_KEY[slider.follows].symbol}" if slider.follows else "not known"
    return f"{found / slider.per_unit:.4g} {slider.unit}"


def changes(positions: Mapping[str, float], energy: Energy) -> list[tuple[str, object]]:
    """What was moved, as `jouleswarm report --set` takes it: `energy.ul_bit_per_j` and its value."""
    found = ((key, value(_BY_KEY[key], at, energy)) for key, at in positions.items())
    return [(f"energy.{key}", worth) for key, worth in found if worth != getattr(energy, key) and worth is not None]


def repriced(scenario: Scenario, positions: Mapping[str, float]) -> Energy:
    """The scenario's constants with the sliders' in their place."""
    moved = changes(positions, scenario.energy)
    return reprice(scenario, moved, "the page")[0].energy if moved else scenario.energy


def command(run: str, positions: Mapping[str, float], energy: Energy) -> str:
    """What prints the whole bill at these prices."""
    told = "".join(f" --set {key}={worth:g}" for key, worth in changes(positions, energy))
    return f"jouleswarm report {shlex.quote(run)}{told}"


def _own(slider: Slider, energy: Energy) -> float | None:
    found: float | None = getattr(energy, slider.key)
    return found
