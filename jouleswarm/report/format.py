"""How a report writes numbers."""

from __future__ import annotations

_NOTHING = "-"


def joules_text(joules: float | None) -> str:
    """Joules to four digits, "-" where not defined or not known; a small run stands beside the paper's large one."""
    if joules is None:
        return _NOTHING
    for unit, factor in (("MJ", 1e6), ("kJ", 1e3)):
        if joules >= factor:
            return f"{joules / factor:.4g} {unit}"
    return f"{joules:.4g} J"


def grams_text(grams: float | None) -> str:
    """Grams of CO2 equivalent to four digits; what is not known is said to be so, it is not nothing."""
    if grams is None:
        return "unknown"
    return f"{grams / 1e3:.4g} kg" if grams >= 1e3 else f"{grams:.4g} g"


def number_text(value: float | None, decimals: int = 1) -> str:
    """A number, "-" for None."""
    return _NOTHING if value is None else f"{value:.{decimals}f}"


def bytes_text(size_bytes: float) -> str:
    """Bytes in a unit that keeps four digits."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= factor:
            return f"{size_bytes / factor:.4g} {unit}"
    return f"{size_bytes:.0f} B"
