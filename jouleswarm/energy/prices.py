"""Other prices for a finished run, as its operator names them; nothing is trained again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from pydantic import ValidationError

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.sections import Energy

Beta = float | Literal["measured"]
"""What `energy.beta` may be: cost of an exact meta-gradient over a first-order one, 1 or more, or the measured one."""


@dataclass(frozen=True)
class Prices:
    """What takes the place of a run's own prices; None keeps the run's own."""

    ul: float | None = None  # E_UL, kb/J (1 kb = 1000 bit)
    sl: float | None = None  # E_SL, kb/J
    dl: float | None = None  # E_DL, kb/J; not set anywhere, it is E_UL
    pue: float | None = None  # gamma
    beta: Beta | None = None
    carbon_datacenter: float | None = None  # gCO2e a kWh
    carbon_robots: float | None = None  # gCO2e a kWh
    via_base_station: bool = False  # price sidelinks as up to the base station and down; False keeps the run's own


class _Kind(NamedTuple):
    """How a price is told and turned into a field of `Energy`, which bounds it."""

    expected: str
    factor: float = 1.0


_EFFICIENCY = _Kind("a number from 1e-09 to 1e+12, in kb/J", factor=1e3)
_PUE = _Kind("a number of 1 or more, up to 1000")
_BETA = _Kind("a number of 1 or more, up to 1e+06")
_INTENSITY = _Kind("a number of 0 or more, up to 1e+06, in gCO2e a kWh")
_FIELDS = {
    "ul": ("ul_bit_per_j", _EFFICIENCY),
    "sl": ("sl_bit_per_j", _EFFICIENCY),
    "dl": ("dl_bit_per_j", _EFFICIENCY),
    "pue": ("pue", _PUE),
    "beta": ("beta", _BETA),
    "carbon_datacenter": ("datacenter_g_per_kwh", _INTENSITY),
    "carbon_robots": ("robots_g_per_kwh", _INTENSITY),
}


def parse_beta(text: str) -> Beta:
    """Beta as it stands on a command line.

    Raises:
        ConfigurationError: it is no number of 1 or more, nor "measured".
    """
    if text == "measured":
        return "measured"
    try:
        value = float(text)
    except ValueError:
        raise ConfigurationError(f"--beta {text}: expected {_BETA.expected}, or measured") from None
    _field("beta", value)
    return value


def reprice(energy: Energy, prices: Prices) -> tuple[Energy, str]:
    """A run's constants at other prices, and what these put into file names: "" for the same prices.

    Raises:
        ConfigurationError: a value beyond what a scenario may have there.
    """
    changes: dict[str, Any] = {}
    words = []
    for name in _FIELDS:
        value: float | Literal["measured"] | None = getattr(prices, name)
        if value is None:
            continue
        changes |= _field(name, value)
        option = name.replace("_", "-")
        words.append(f"{option}-measured" if value == "measured" else f"{option}{value:g}")
    if prices.via_base_station:
        changes["sidelink"] = "via_base_station"
        words.append("via-base-station")
    priced = energy.model_copy(update=changes)
    return priced, "" if priced == energy else "-" + "-".join(words)


def _field(name: str, value: float | Literal["measured"]) -> dict[str, Any]:
    """The field of `Energy` that a price sets, checked as in a scenario."""
    field, kind = _FIELDS[name]
    change: dict[str, Any] = {field: value if value == "measured" else value * kind.factor}
    try:
        Energy.model_validate(change)
    except ValidationError:
        option = name.replace("_", "-")
        raise ConfigurationError(f"--{option} {value:g}: expected {kind.expected}") from None
    return change
