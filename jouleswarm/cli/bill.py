"""`jouleswarm bill`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.cli.options import EnergyOption, must_exist


def bill(
    counts: Annotated[
        list[Path] | None, typer.Argument(help="CSV, TOML or JSON: what was done; several, or a folder, are merged.")
    ] = None,
    energy: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A TOML file with [energy], and [[robots]]; default: the paper's Table I."),
    ] = None,
    set_: EnergyOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print plain data: joules, grams, counts.")] = False,
    figures: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Draw the paper's Fig. 4 of arms with different t0.")
    ] = None,
    example: Annotated[bool, typer.Option("--example", help="Print a file to start from, with all words.")] = False,
) -> None:
    """Price your own experiment: rounds, sizes and bytes in; joules by phase, cause and site, and break-even out.

    \b
    A table of what and value is enough; an empty cell is for all arms or tasks:
        arm,task,what,value
        ,,robots,10
        ,,model_bytes,2400000
        ,,batches,50
        FedAvg,,rounds,120

    By a server where no `links` between neighbours are told. What you have counted (uplink_bytes, gradients, ...) comes
    before what is worked out. `jouleswarm bill --example` has all words; docs/bill.md has the paper's Table II.
    """
    from jouleswarm.energy.rows import example as example_file

    if example:
        print(example_file(), end="")
        return
    if not counts:
        raise typer.BadParameter("expected a file of counts, or --example")
    must_exist("counts", *counts)
    from jouleswarm.report.calculated import calculate, document, print_calculated

    found = calculate(counts[0] if len(counts) == 1 else counts, energy, set_ or ())
    if as_json:
        print(json.dumps(document(found), indent=2))
    else:
        print_calculated(found)
    if figures is not None:
        from jouleswarm.studies.calculated import draw_calculated

        for path in draw_calculated(found.facts, found.tariff.energy, figures):
            typer.echo(f"wrote {path}", err=True)
