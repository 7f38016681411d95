"""What each arm had learned by the time that a budget was spent."""

from __future__ import annotations

import re

import pandas as pd

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.report.table import Table
from jouleswarm.runs.curves import within

_UNITS = {
    "J": ("joules", 1.0),
    "kJ": ("joules", 1e3),
    "MJ": ("joules", 1e6),
    "Wh": ("joules", 3600.0),
    "kWh": ("joules", 3.6e6),
    "bit": ("bits", 1.0),
    "kbit": ("bits", 1e3),
    "Mbit": ("bits", 1e6),
    "Gbit": ("bits", 1e9),
    "s": ("seconds", 1.0),
    "min": ("seconds", 60.0),
    "h": ("seconds", 3600.0),
    "gradients": ("gradients", 1.0),
    "motions": ("motions", 1.0),
}


def parse_budget(text: str) -> tuple[str, float]:
    """What is spent (a column of `runs.curves`), and how much of it: `10kJ`, `500 J`, `2 Gbit`, `4000 motions`.

    Raises:
        ConfigurationError: it is no such amount.
    """
    found = re.fullmatch(r"\s*([0-9.eE+]+(?:-[0-9]+)?)\s*([A-Za-z]+)\s*", text)
    try:
        amount = float(found[1]) if found else 0.0
    except ValueError:
        amount = 0.0
    if not found or found[2] not in _UNITS or not 0 < amount < float("inf"):
        raise ConfigurationError(f"--budget {text}: expected a number and one of {', '.join(_UNITS)}, for example 10kJ")
    what, factor = _UNITS[found[2]]
    return what, amount * factor


def budget_table(points: pd.DataFrame, budget: str) -> Table:
    """A row an arm.

    Raises:
        ConfigurationError: the budget is no amount, or of what is not known.
    """
    what, amount = parse_budget(budget)
    if points[what].isna().any():
        raise ConfigurationError(
            f"--budget {budget}: {what} are not known of this run; bytes must be counted, and for seconds energy needs "
            "ul_bit_per_s and sl_bit_per_s"
        )
    rows = []
    for arm, point in within(points, amount, what).items():
        if point is None:
            rows.append([arm, "-", "-", "not even its stage is paid for", "-"])
            continue
        reward = "-" if pd.isna(point["reward"]) else f"{point['reward']:.1f}"
        learned = point["learned"] or "none"
        rows.append([arm, str(point["round"]), f"{point['share_learned']:.0%}", learned, reward])
    headings = ["arm", "rounds of each cluster", "learned", "tasks", "mean R"]
    return Table(title=f"What {budget} had reached", headings=headings, rows=rows)
