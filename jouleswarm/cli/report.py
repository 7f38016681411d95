"""`jouleswarm report` and `jouleswarm audit`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jouleswarm.cli.document import JsonOption, print_document
from jouleswarm.cli.options import Budget, Details, EnergyFile, EnergyOption, Figures, PowerLogNames, PowerLogs

Beta = Annotated[
    str | None, typer.Option(metavar="FLOAT|measured", help="Cost of an exact meta-gradient over a first-order one.")
]
CarbonDatacenter = Annotated[float | None, typer.Option(help="Carbon intensity where the data center is, gCO2e a kWh.")]
CarbonRobots = Annotated[float | None, typer.Option(help="Carbon intensity where the robots are charged, gCO2e a kWh.")]


def report(
    run_directory: Annotated[Path, typer.Argument(help="A run directory.")],
    ul: Annotated[float | None, typer.Option(help="Uplink efficiency, kb/J.")] = None,
    sl: Annotated[float | None, typer.Option(help="Sidelink efficiency, kb/J.")] = None,
    dl: Annotated[float | None, typer.Option(help="Downlink efficiency, kb/J.")] = None,
    pue: Annotated[float | None, typer.Option(help="Power usage effectiveness of the data center.")] = None,
    beta: Beta = None,
    carbon_datacenter: CarbonDatacenter = None,
    carbon_robots: CarbonRobots = None,
    via_base_station: Annotated[bool, typer.Option(help="Sidelinks go up to the base station and down.")] = False,
    set_: EnergyOption = None,
    budget: Budget = None,
    why: Annotated[bool, typer.Option(help="What each bill hangs on, and where the verdict turns.")] = False,
    energy: EnergyFile = None,
    meter: PowerLogs = None,
    meter_name: PowerLogNames = None,
    meter_shift: Annotated[float, typer.Option(help="Seconds to add to the logs' times.")] = 0.0,
    figures: Figures = "",
    details: Details = False,
    as_json: JsonOption = False,
) -> None:
    """Tell a run's answer, at its own prices or at any others. Nothing is trained again; its files stay.

    --ul, --sl and the like are short for --set: --ul 500 is --set energy.ul_bit_per_j=500e3.
    """
    from jouleswarm.runs.files import read_manifest

    read_manifest(run_directory)  # before anything heavy is loaded
    from jouleswarm.common.figure_kinds import figure_kinds
    from jouleswarm.common.scenario.reading import energy_file
    from jouleswarm.energy.repricing import Prices, parse_beta
    from jouleswarm.report.outside import Meters
    from jouleswarm.report.report import report as print_bill

    kinds = figure_kinds(figures)
    prices = Prices(
        ul=ul,
        sl=sl,
        dl=dl,
        pue=pue,
        beta=None if beta is None else parse_beta(beta),
        carbon_datacenter=carbon_datacenter,
        carbon_robots=carbon_robots,
        via_base_station=via_base_station,
    )
    changes = [*energy_file(energy), *prices.changes, *(set_ or ())]
    meters = Meters(meter or (), meter_name or (), meter_shift) if meter or meter_name or meter_shift else None
    if as_json:
        from jouleswarm.report.document import report_document

        print_document(report_document(run_directory, changes, budget=budget, why=why, meters=meters))
        return
    asked: dict[str, Any] = {"budget": budget, "why": why, "meters": meters, "details": details}
    print_bill(run_directory, changes=changes, **asked, html=bool(kinds), figures=kinds)


def audit(as_json: JsonOption = False) -> None:
    """Print the paper's published figures beside what its equations and constants give."""
    from jouleswarm.report.audit import audit_document, print_audit

    if as_json:
        print_document(audit_document())
    else:
        print_audit()
