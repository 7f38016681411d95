"""`jouleswarm chaos`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from jouleswarm.cli.options import Out, ScenarioFile
from jouleswarm.common.options import SetOption


def chaos(
    scenario: ScenarioFile,
    faults: Annotated[int, typer.Option(min=1, help="How many faults to inject.")] = 100,
    seed: Annotated[int, typer.Option(help="Seed of the faults' moments and victims; the scenario keeps its own.")] = 1,
    pause_s: Annotated[
        float, typer.Option(min=0.1, help="How long the broker is away, somebody is stopped, or links are bad.")
    ] = 20.0,
    kind: Annotated[list[str] | None, typer.Option(help="Only this kind of fault; may be repeated.")] = None,
    set_: SetOption = None,
    out: Out = Path("runs/chaos"),
) -> None:
    """Show that faults change nothing but the clock: run a scenario undisturbed, then again and again with faults.

    Processes are killed and stopped, also while they leave or write their state, the broker taken away, connections
    cut in the middle of a message, messages sent twice, robots and runs started twice; runs are interrupted, robbed of
    a robot's state or of their disk's space, and gone on with. Every run must end with the same rounds and
    bit-identical weights, and what must be refused or told must be; the exit code is 1 if not. The memories of motions
    are made so small that they are written over in every run, unless --set says otherwise.

    Example: jouleswarm chaos toy --faults 100 --seed 1
    """
    import typing

    from jouleswarm.chaos.chaos import CSV, run_chaos, wrapping
    from jouleswarm.chaos.faults import KINDS, FaultKind
    from jouleswarm.chaos.table import chaos_table
    from jouleswarm.common.scenario.reading import load_scenario, scenario_path
    from jouleswarm.report.table import show

    unknown = [each for each in kind or () if each not in KINDS]
    if unknown:
        raise typer.BadParameter(f"got {', '.join(unknown)}, expected some of: {', '.join(KINDS)}")
    chosen = typing.cast("list[FaultKind]", kind) or KINDS
    # A broker may be away for longer than in a run that nobody disturbs.
    overrides = [f"bus.connect_timeout_s={max(60.0, 4 * pause_s)}", "bus.resend_after_s=3"]
    overrides += [*wrapping(load_scenario(scenario, set_ or ())), *(set_ or ())]
    settings = load_scenario(scenario, overrides)
    options = [
        "--scenario",
        str(scenario_path(scenario).resolve()),
        *(part for each in overrides for part in ("--set", each)),
    ]
    console = Console()
    done = run_chaos(settings, options, out, faults, seed, pause_s, chosen, console)
    show(chaos_table(done), console)
    console.print(f"as CSV: {out / CSV}", highlight=False)
    if len(done) < faults:
        missing = f"{faults - len(done)} of {faults} faults were not injected"
        console.print(f"{missing}: the runs were over before their phase; use a longer scenario", highlight=False)
    if len(done) < faults or not all(fault.is_survived for fault in done):
        raise typer.Exit(1)
