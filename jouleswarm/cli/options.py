"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.figure_kinds import figure_kinds
from jouleswarm.common.options import SCENARIO_HELP


def complete_scenario(incomplete: str) -> list[str]:
    """What a shell offers for a scenario: names of those that come with the package, files and folders."""
    from jouleswarm.common.scenario.reading import scenario_names

    found = [*Path().glob(f"{incomplete}*.toml"), *(each for each in Path().glob(f"{incomplete}*/") if each.is_dir())]
    files = [f"{each}/" if each.is_dir() else str(each) for each in sorted(found)]
    return [name for name in scenario_names() if name.startswith(incomplete)] + files


SCENARIO = typer.Argument(envvar="JOULESWARM_SCENARIO", help=SCENARIO_HELP, autocompletion=complete_scenario)
ScenarioFile = Annotated[Path, SCENARIO]
Seed = Annotated[int | None, typer.Option(help="Seed in place of the scenario's.")]
Out = Annotated[Path, typer.Option(envvar="JOULESWARM_OUT", help="Folder for run directories.")]
RunId = Annotated[str | None, typer.Option(envvar="JOULESWARM_RUN", help="Name of the run and of its directory.")]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="tcp://HOST:PORT", envvar="JOULESWARM_SCHEDULER", help="Run on the workers of this Dask scheduler."
    ),
]

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


Measured = Annotated[
    bool,
    typer.Option(
        "--measure", help="Have each process measure its own joules too (RAPL, NVML, else estimated by CPU time)."
    ),
]
Budget = Annotated[
    str | None,
    typer.Option(help="What each arm had learned when so much was spent: 10kJ, 2Gbit, 4000motions, 500gradients."),
]
PowerLogs = Annotated[
    list[Path] | None,
    typer.Option(metavar="CSV", help="A power meter's log (time, watt or joules, name): measured against priced."),
]
PowerLogNames = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=PROCESS", help="Whose a name in the logs is: shelly1=agent-3. May be repeated."),
]
Figures = Annotated[
    str,
    typer.Option(
        metavar="KIND,...",
        help="Draw figures as files of these kinds, of png, svg and pdf.",
        callback=lambda given: ",".join(figure_kinds(given)),
    ),
]
NoFigures = Annotated[bool, typer.Option("--no-figures", help="Draw none, and write no report.html.")]
Details = Annotated[bool, typer.Option("--details", help="Print all tables and notes too, before the answer.")]
Resume = Annotated[
    Path | None,
    typer.Option(help="In place of a scenario: go on with this run directory, from where it was interrupted."),
]
Restarts = Annotated[
    int, typer.Option(min=0, help="How often each process that was killed is started again, to the same end.")
]
MetricsPort = Annotated[
    int | None,
    typer.Option(
        min=0, max=65535, envvar="JOULESWARM_METRICS_PORT", help="Serve Prometheus metrics of the run; 0: a free port."
    ),
]
MetricsHost = Annotated[
    str, typer.Option(envvar="JOULESWARM_METRICS_HOST", help="Address that metrics are served on; 0.0.0.0: on all.")
]
Tensorboard = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        envvar="JOULESWARM_TENSORBOARD",
        help="Write TensorBoard's event files into DIR/RUN/ARM while it runs.",
    ),
]
Mlflow = Annotated[
    str | None,
    typer.Option(
        metavar="URI",
        envvar="JOULESWARM_MLFLOW",
        help="Log to MLflow while it runs: a server's address, or sqlite:///mlflow.db.",
    ),
]
Durable = Annotated[
    bool,
    typer.Option("--durable", help="Have each round on the disk: --resume works after a power failure too."),
]
Dry = Annotated[
    bool, typer.Option("--dry", help="Run nothing: print what it will cost, by the closed form, and how long.")
]
Rounds = Annotated[
    int | None, typer.Option(min=1, help="Of each task, beside federation.max_rounds, where nothing is run (--dry).")
]
KeepState = Annotated[
    bool,
    typer.Option("--keep-state", help="Keep how each arm ends: --resume can then go on with more rounds (--set)."),
]
ShowPage = Annotated[
    bool, typer.Option("--page", help="Show the run in the browser too, on this machine alone; stays until Ctrl-C.")
]


def must_exist(what: str, *paths: Path) -> None:
    """Before anything heavy is loaded: a misspelt name is told at once.

    Raises:
        ConfigurationError: a path is not there.
    """
    for path in paths:
        if not path.exists():
            raise ConfigurationError(f"{what} {path}: cannot be read (No such file or directory)")


def overrides(set_: list[str] | None, seed: int | None) -> list[str]:
    """`--set` and `--seed` as overrides of a scenario."""
    return [*(set_ or ()), *([f"seed={seed}"] if seed is not None else ())]
