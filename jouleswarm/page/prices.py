"""The sliders: each a constant of the energy model, from a tenth to ten times the run's own, or an intensity."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.repricing import reprice


class Slider(NamedTuple):
    """A constant that is moved. Its position is a power of ten on the run's own value, or the value itself."""

    key: str
    """Of the scenario's section energy."""
    symbol: str
    """As HTML."""
    meaning: str
    unit: str
    per_unit: float = 1.0
    """What a unit is in the scenario's own."""
    is_factor: bool = True
    follows: str = ""
    """The key whose value it has as long as it has none of its own."""


_UPLINK = Slider("ul_bit_per_j", "E<sub>UL</sub>", "uplink efficiency", "kb/J", 1e3)
_SIDELINK = Slider("sl_bit_per_j", "E<sub>SL</sub>", "sidelink efficiency", "kb/J", 1e3)
_DOWNLINK = Slider("dl_bit_per_j", "E<sub>DL</sub>", "downlink efficiency", "kb/J", 1e3, follows=_UPLINK.key)
LINKS = (_UPLINK, _DOWNLINK, _SIDELINK)
"""Of what was moved and nothing else."""
SLIDERS = (
    _UPLINK,
    _SIDELINK,
    Slider("p0_w", "P<sub>0</sub>", "data center power", "W"),
    Slider("t0_batch_s", "T<sub>0</sub>", "data center time of a batch gradient", "ms", 1e-3),
    Slider("pk_w", "P<sub>k</sub>", "robot power", "W"),
    Slider("tk_batch_s", "T<sub>k</sub>", "robot time of a batch gradient", "ms", 1e-3),
    Slider("datacenter_g_per_kwh", "carbon, data center", "carbon intensity of its electricity", "g/kWh", 1, False),
    Slider("robots_g_per_kwh", "carbon, robots", "carbon intensity where they are charged", "g/kWh", 1, False),
)
_BY_KEY = {each.key: each for each in (*SLIDERS, *LINKS)}
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
