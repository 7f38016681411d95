"""`jouleswarm calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.cli.options import ScenarioFile
from jouleswarm.common.options import SetOption


def calibrate(
    role: Annotated[str, typer.Option(help="Whose constants: robot (T_k, P_k) or datacenter (T_0, P_0, beta).")],
    scenario: ScenarioFile = Path("quick"),
    device: Annotated[str, typer.Option(help="What computes: cpu or cuda.")] = "cpu",
    repeats: Annotated[int, typer.Option(min=3, help="Batch gradients to time, or more until 2 s are over.")] = 100,
    write: Annotated[
        Path | None, typer.Option(help="Put the lines into the table [energy] of this TOML file; its others stay.")
    ] = None,
    set_: SetOption = None,
) -> None:
    """Measure this machine's own Table I: seconds and joules of a batch gradient of the scenario's network.

    Run it once on a robot and once in the data center, each with --write to the same file, then price with it:

    \b
    jouleswarm calibrate quick --role robot --write energy.toml
    jouleswarm calibrate quick --role datacenter --device cuda \\
        --write energy.toml
    jouleswarm run quick --energy energy.toml
    jouleswarm report runs/RUN --energy energy.toml   # a run that is over

    Seconds are medians, after a warm-up; of a processor in one thread and by CPU time, so that other work on the
    machine does not count. Joules are read from RAPL and NVML where they can be; else they are estimated as CPU time x
    share x TDP / cores, and the line says so: --set measure.tdp_w=15 --set measure.cores=4 tells what it has.
    """
    import sys

    from rich.console import Console
    from rich.progress import Progress

    from jouleswarm.common.process import use_one_thread
    from jouleswarm.common.scenario.reading import load_scenario

    settings = load_scenario(scenario, set_ or ())
    from jouleswarm.methods.calibration import calibrate as measured
    from jouleswarm.report.calibration import calibration_table, check_writable, energy_lines, write_energy
    from jouleswarm.report.table import show

    check_writable(write)
    use_one_thread()
    console = Console()
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        work = bar.add_task(f"{role} on {device}", total=1.0)
        found = measured(settings, role, device, repeats, lambda part: bar.update(work, completed=part))
    show(calibration_table(found, settings.name, device), console)
    lines = energy_lines(found, settings.name, device)
    if write is not None:
        write_energy(write, lines)
        print(f"written into {write}; use it by --energy {write}")
    print("[energy]", *lines.values(), sep="\n")
