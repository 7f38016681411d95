"""`jouleswarm report`: the bill of a run on the terminal, at the run's own or at other efficiencies.

Pricing again never touches what the run wrote: `report.html` and `figures/energy.*` of other prices get the prices
into their names, for example `report-ul500-sl200.html`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAVY
from rich.console import Console
from rich.table import Table

from common.errors import ConfigurationError
from common.settings import Energy
from fleet.figures import write_figures
from fleet.report_data import Run, load_run
from fleet.report_html import write_html
from fleet.report_text import TextTable, bytes_table, energy_table, headline, notes, rounds_table, verdicts

__all__ = ["Run", "load_run", "print_report", "report", "reprice"]


def report(
    run_dir: str | Path,
    ul_kb_per_j: float | None = None,
    sl_kb_per_j: float | None = None,
    dl_kb_per_j: float | None = None,
    pue: float | None = None,
    beta: float | None = None,
    via_base_station: bool = False,
    html: bool = False,
    figures: bool = False,
    console: Console | None = None,
) -> list[Path]:
    """Print the bill of a run, and draw figures and `report.html` if asked; returns the files written.

    Args:
        ul_kb_per_j: E_UL in kb/J (1 kb = 1000 bit); None keeps the run's own, as for all that follow.
        sl_kb_per_j: E_SL in kb/J.
        dl_kb_per_j: E_DL in kb/J; not set anywhere, it is E_UL.
        pue: gamma.
        beta: cost of a meta-gradient over a first-order one.
        via_base_station: price sidelinks as up to the base station and down; False keeps the run's own.

    Raises:
        ConfigurationError: no such directory, or a price that is no price.
        RunError: the directory is not a run's, or damaged.
    """
    run = load_run(run_dir)
    energy, suffix = reprice(
        run.scenario.energy,
        ul=ul_kb_per_j,
        sl=sl_kb_per_j,
        dl=dl_kb_per_j,
        pue=pue,
        beta=beta,
        via_base_station=via_base_station,
    )
    print_report(run, energy, console)
    written = write_figures(run, energy, suffix) if figures else []
    if html:
        written.append(write_html(run, energy, suffix))
    return written


def reprice(
    energy: Energy,
    *,
    ul: float | None = None,
    sl: float | None = None,
    dl: float | None = None,
    pue: float | None = None,
    beta: float | None = None,
    via_base_station: bool = False,
) -> tuple[Energy, str]:
    """Other prices (efficiencies in kb/J), and what they put into file names: "" for the same prices.

    Raises:
        ConfigurationError: a value that is no efficiency (above 0) or no factor (1 or more).
    """
    changes: dict[str, Any] = {}
    named = {"ul": ul, "sl": sl, "dl": dl, "pue": pue, "beta": beta}
    for name, value in named.items():
        if value is None:
            continue
        factor = name in ("pue", "beta")
        if not math.isfinite(value) or value < (1 if factor else 0) or value == 0:
            expected = "a number of 1 or more" if factor else "a number above 0, in kb/J"
            raise ConfigurationError(f"--{name} {value:g}: expected {expected}")
        changes[name if factor else f"{name}_bit_per_j"] = value if factor else value * 1e3
    if via_base_station:
        changes["sidelink"] = "via_base_station"
    priced = energy.model_copy(update=changes)
    words = [f"{name}{value:g}" for name, value in named.items() if value is not None]
    words += ["via-base-station"] if via_base_station else []
    return priced, "" if priced == energy else "-" + "-".join(words)


def print_report(run: Run, energy: Energy | None = None, console: Console | None = None) -> None:
    """Print a run's tables; `energy` in place of the scenario's own constants prices it again."""
    energy = energy or run.scenario.energy
    console = console or Console()
    console.print(f"{run.name}: {headline(run, energy)}", highlight=False)
    console.print(_table(rounds_table(run)))
    for arm in run.scenario.arm_names:
        console.print(_table(energy_table(run, arm, energy)))
    console.print(_table(bytes_table(run, energy)))
    for line in verdicts(run, energy):
        console.print(line, style="bold", highlight=False)
    for line in notes(run, energy):
        console.print(line, style="dim", highlight=False)


def _table(text: TextTable) -> Table:
    table = Table(title=text.title, box=SIMPLE_HEAVY, padding=(0, 1, 0, 0))
    for place, heading in enumerate(text.headings):
        table.add_column(heading, justify="right" if place else "left")
    for number, row in enumerate(text.rows):
        strong = number in text.strong
        table.add_row(*row, style="bold" if strong else "", end_section=strong)
    return table
