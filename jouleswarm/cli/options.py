"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.common.options import SCENARIO_HELP

ScenarioFile = Annotated[Path, typer.Argument(envvar="JOULESWARM_SCENARIO", help=SCENARIO_HELP)]
Seed = Annotated[int | None, typer.Option(help="Seed in place of the scenario's.")]
Out = Annotated[Path, typer.Option(envvar="JOULESWARM_OUT", help="Folder for run directories.")]
RunId = Annotated[str | None, typer.Option(envvar="JOULESWARM_RUN", help="Name of the run and of its directory.")]

EnergyOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="energy.KEY=VALUE",
        help="Any constant, intensity or price list of the scenario's section energy. May be repeated.",
    ),
]

EnergyFile = Annotated[
    Path | None,
    typer.Option(
        "--energy",
        metavar="FILE",
        help="A TOML file with a table [energy], as `jouleswarm calibrate --write` makes: its constants in place of "
        "the scenario's. Other options come after it.",
    ),
]


def overrides(set_: list[str] | None, seed: int | None) -> list[str]:
    """`--set` and `--seed` as overrides of a scenario."""
    return [*(set_ or ()), *([f"seed={seed}"] if seed is not None else ())]
