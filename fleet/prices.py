"""Other prices for a finished run, as its operator names them; nothing is trained again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from common.errors import ConfigurationError
from common.settings import Energy

Beta = float
"""What `energy.beta` may be: cost of a meta-gradient over a first-order one, 1 or more."""


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
    """How a price is checked and turned into a field of `Energy`."""

    expected: str
    fits: Callable[[float], bool]
    factor: float = 1.0


_EFFICIENCY = _Kind("a number above 0, in kb/J", lambda value: value > 0, factor=1e3)
_FACTOR = _Kind("a number of 1 or more", lambda value: value >= 1)
_INTENSITY = _Kind("a number of 0 or more, in gCO2e a kWh", lambda value: value >= 0)
_FIELDS = {
    "ul": ("ul_bit_per_j", _EFFICIENCY),
    "sl": ("sl_bit_per_j", _EFFICIENCY),
    "dl": ("dl_bit_per_j", _EFFICIENCY),
    "pue": ("pue", _FACTOR),
    "beta": ("beta", _FACTOR),
    "carbon_datacenter": ("datacenter_g_per_kwh", _INTENSITY),
    "carbon_robots": ("robots_g_per_kwh", _INTENSITY),
}


def parse_beta(text: str) -> Beta:
    """Beta as it stands on a command line.

    Raises:
        ConfigurationError: it is no number of 1 or more.
    """
    try:
        value = float(text)
    except ValueError:
        raise ConfigurationError(f"--beta {text}: expected {_FACTOR.expected}") from None
    _check("beta", value, _FACTOR)
    return value


def reprice(energy: Energy, prices: Prices) -> tuple[Energy, str]:
    """A run's constants at other prices, and what these put into file names: "" for the same prices.

    Raises:
        ConfigurationError: a value that is no efficiency (above 0), no factor (1 or more) or no intensity (0 or more).
    """
    changes: dict[str, Any] = {}
    words = []
    for name, (field, kind) in _FIELDS.items():
        value: float | None = getattr(prices, name)
        if value is None:
            continue
        option = name.replace("_", "-")
        _check(option, value, kind)
        changes[field] = value * kind.factor
        words.append(f"{option}{value:g}")
    if prices.via_base_station:
        changes["sidelink"] = "via_base_station"
        words.append("via-base-station")
    priced = energy.model_copy(update=changes)
    return priced, "" if priced == energy else "-" + "-".join(words)


def _check(option: str, value: float, kind: _Kind) -> None:
    if not math.isfinite(value) or not kind.fits(value):
        raise ConfigurationError(f"--{option} {value:g}: expected {kind.expected}")
