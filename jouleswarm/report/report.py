"""`jouleswarm report`: the bill of a run on the terminal, at the run's own or at other prices; its answer comes last.

Pricing again never touches what the run wrote: `report.html` and `figures/energy.*` of other prices get the prices
into their names, for example `report-ul500-sl200.html`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console

from jouleswarm.common.disk.trouble import full_disk_is_told
from jouleswarm.common.errors import ConfigurationError, RunError, usable
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import Override
from jouleswarm.energy.repricing import Prices
from jouleswarm.metering.metered import Metered
from jouleswarm.report.answer import answer, said
from jouleswarm.report.metered_report import report_metered
from jouleswarm.report.notes import headline, notes, warnings
from jouleswarm.report.opened import load
from jouleswarm.report.outside import Meters, outside_table
from jouleswarm.report.screen import show_answer, show_next
from jouleswarm.report.table import Table, show
from jouleswarm.report.tables import energy_table, report_tables
from jouleswarm.report.why import why_tables
from jouleswarm.runs.answer import Answer
from jouleswarm.runs.run import Run

_DETAILED_ARMS = 3  # on a terminal; report.html has a table for each of any number


def report(
    run_dir: str | Path,
    prices: Prices | None = None,
    *,
    changes: Iterable[Override] = (),
    budget: str | None = None,
    why: bool = False,
    meters: Meters | None = None,
    details: bool = False,
    html: bool = False,
    figures: Sequence[str] = (),
    console: Console | None = None,
) -> list[Path]:
    """Print the answer of a run, and write `report.html` and figures of the kinds asked for; returns the files written.

    Args:
        run_dir: what `jouleswarm run` printed.
        prices: in place of the run's own.
        budget: what had been learned by then, such as 10kJ.
        why: what each bill hangs on.
        meters: what was measured from outside.
        details: print all tables and notes first.
        changes: of the scenario's section energy, any constant in place of the run's own.

    Raises:
        ConfigurationError: no such directory, a price that is no price, or a power log that is none of this run's.
        RunError: the directory is not a run's, or damaged; or its counters contradict each other (all is written).
    """
    own = load(run_dir)
    changes = [*(prices or Prices()).changes, *changes]
    if isinstance(own, Metered):
        if budget is not None or why or meters is not None:
            raise ConfigurationError(f"{run_dir}: of what a meter counted: no --budget, --why or --meter")
        return report_metered(own, changes, html_too=html, console=console)
    priced, suffix = own.priced(changes)
    run, energy = own.at(priced), priced.energy
    more = why_tables(run, energy) if why else []
    if budget is not None:
        from jouleswarm.report.budget import budget_table  # late, as the figures are: with pandas
        from jouleswarm.runs.curves import curves

        more.append(budget_table(curves(run, energy), budget))
    if meters is not None:
        more.append(outside_table(run, energy, meters))
    before = answer(own, own.scenario.energy) if suffix else None
    print_report(run, energy, console, more, details=details, before=before)
    with full_disk_is_told(str(run_dir)), usable("run directory", run.path, RunError):
        written: list[Path] = []
        if figures:
            from jouleswarm.report.figures import write_figures  # late: it loads what draws

            written = write_figures(run, energy, suffix, figures)
        if html:
            from jouleswarm.report.html import write_html

            written.append(write_html(run, energy, suffix))
    show_next(run, written, console or Console())
    if run.misfits:
        raise RunError(f"{run.path}: {warnings(run)[0]}")
    return written


def print_report(
    run: Run,
    energy: Energy | None = None,
    console: Console | None = None,
    more: Iterable[Table] = (),
    *,
    details: bool = False,
    before: Answer | None = None,
) -> None:
    """Print a run's answer after `more`, with `details` after all tables and notes; `energy` in place of the scenario's
    own constants prices it again, and `before` is the answer at those."""
    energy = energy or run.scenario.energy
    console = console or Console()
    # All of it before anything is printed: a price list of the user's may fail.
    found = answer(run, energy)
    told, tables = said(run, energy, found, before), [*(_detailed(run, energy) if details else ()), *more]
    for line in warnings(run):
        console.print(line, style="bold red", highlight=False)
    for table in tables:
        show(table, console)
    if details:
        for line in (f"{run.name}: {headline(run, energy)}", *notes(run, energy)):
            console.print(line, style="dim", highlight=False)
    show_answer(run, energy, found, told, console)


def _detailed(run: Run, energy: Energy) -> list[Table]:
    detailed = run.scenario.arm_names if len(run.scenario.arms) <= _DETAILED_ARMS else ()
    return [*report_tables(run, energy), *(energy_table(run, arm, energy) for arm in detailed)]
