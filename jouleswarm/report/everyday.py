"""Joules in terms of every day. Pure."""

from __future__ import annotations

from collections.abc import Sequence

PHONE_WH = 15.0
"""What a phone's battery holds: 3.9 Ah at 3.85 V; what its charger loses is left out (docs/energy.md)."""
_J_PER_WH = 3600.0
_LEAST_KWH = 0.01


def everyday(joules: Sequence[float]) -> str:
    """What arms have spent, each more than nothing: `0.104 kWh against 0.00227 kWh: a phone charged 6.9 times ...`."""
    hours = [each / _J_PER_WH for each in joules]
    unit, factor = ("kWh", 1e-3) if max(hours) >= 1e3 * _LEAST_KWH else ("Wh", 1.0)
    told = " against ".join(f"{factor * each:.3g} {unit}" for each in hours)
    charges = " against ".join(f"{_count(each / PHONE_WH)}" for each in hours)
    return f"{told}: a phone charged {charges} times ({PHONE_WH:g} Wh a charge)"


def _count(number: float) -> str:
    return f"{number:,.0f}" if number >= 10 else f"{number:.2g}"
