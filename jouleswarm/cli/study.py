"""The command line of the studies: `jouleswarm study ...`, the commands of one group."""

from __future__ import annotations

import os
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from jouleswarm.cli.options import EnergyOption, Figures, ScenarioFile, Scheduler
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.figure_kinds import DEFAULT, figure_kinds
from jouleswarm.common.options import SetOption
from jouleswarm.studies.names import STUDIES, StudyName

study = typer.Typer(
    no_args_is_help=True,
    help="Run many deployments and make tables and figures of them. A study that was cut short goes on where it was.",
)
_CORES = os.cpu_count() or 1


class Profile(StrEnum):
    """Which network and frames a study runs with."""

    COMPACT = "compact"
    PAPER = "paper"

    @property
    def scenario(self) -> Path:
        """The scenario file behind the profile."""
        return Path({"compact": "quick", "paper": "paper"}[self.value])


ProfileOption = Annotated[Profile, typer.Option(help="compact: scenario quick; paper: scenario paper.")]
ScenarioChoice = Annotated[
    Path | None,
    typer.Option(envvar="JOULESWARM_SCENARIO", help="Scenario, a file or a name, in place of the profile's."),
]
Seeds = Annotated[int | None, typer.Option(help="How many seeds. Default: the study's own.")]
FirstSeed = Annotated[int, typer.Option(help="The first of the seeds.")]
MoreSeeds = Annotated[
    int, typer.Option(min=0, help="Of `study paper`: so many further seeds, with --t0 and without transfer alone.")
]
T0 = Annotated[int | None, typer.Option("--t0", help="Rounds of meta-training. Default: the study's own.")]
Methods = Annotated[
    str | None, typer.Option(help="Methods, with commas between; fl is always among them. Default: the study's own.")
]
TunedOption = Annotated[
    Path | None, typer.Option("--tuned", help="TOML file with settings of single methods (results/tuning/best.toml).")
]
Workers = Annotated[int, typer.Option(help="Deployments at a time, on this machine.")]
Work = Annotated[Path | None, typer.Option(help="Folder for run directories. Default: runs/study-NAME-PROFILE.")]
Results = Annotated[
    Path | None,
    typer.Option(help="Folder for results. Default: results/PROFILE, for others than paper results/PROFILE-NAME."),
]
Keep = Annotated[bool, typer.Option("--keep", help="Keep weights and logs of every run.")]


@study.command()
def tables(
    results_directory: Annotated[Path, typer.Argument(help="A results folder of a study.")],
    set_: EnergyOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for what is made; default the same. Needed where --set is.")
    ] = None,
    figures: Figures = DEFAULT,
) -> None:
    """Make a study's tables and figures again from its facts.csv, at other prices too. Nothing is run.

    With energy.datacenter_g_per_kwh and energy.robots_g_per_kwh the tables have gCO2e beside joules.
    """
    from jouleswarm.studies.record import read_record

    read_record(results_directory)  # before anything heavy is loaded
    from jouleswarm.studies.run import make_tables, reprice

    kinds = figure_kinds(figures)
    if set_ or out:
        _list(reprice(results_directory, set_ or [], out, kinds))
    else:
        _list(make_tables(results_directory, kinds))


@study.command()
def distance(
    scenario: ScenarioFile = Path("quick"),
    set_: SetOption = None,
    results: Annotated[Path, typer.Option(help="Folder for the table and the figure.")] = Path("results/distance"),
) -> None:
    """Joules of sidelinks, direct and via the base station, as that moves away (docs/radio.md). Nothing is run."""
    from jouleswarm.common.scenario.reading import load_scenario
    from jouleswarm.studies.distance import study_distance

    found, written = study_distance(load_scenario(scenario, set_ or ()), results)
    print(found)
    _list(written)


@study.command()
def savazzi2021(
    facts: Annotated[
        Path, typer.Argument(help="A results folder of `study baselines`, whose facts.csv is priced.")
    ] = Path("results/compact-baselines"),
    set_: EnergyOption = None,
    results: Annotated[Path, typer.Option(help="Folder for tables and figures.")] = Path("results/savazzi2021"),
) -> None:
    """Centralized learning, FL by a server and consensus FL over link efficiencies and countries, after Savazzi et al.
    2021 (arXiv 2103.10346): where each wins. Nothing is run.
    """
    from jouleswarm.studies.record import read_record

    read_record(facts)  # before anything heavy is loaded
    from jouleswarm.studies.savazzi2021 import make_study

    _list(make_study(facts, set_ or [], results))


@study.command()
def write(
    pages: Annotated[
        list[Path] | None, typer.Argument(help="Pages of Markdown. Default: those here and in docs/ that name numbers.")
    ] = None,
    results: Annotated[Path, typer.Option(help="Folder of the studies' results folders.")] = Path("results"),
    check: Annotated[bool, typer.Option("--check", help="Write nothing; say the first line that differs.")] = False,
) -> None:
    """Write numbers of committed results into pages, by the expressions that name them (CONTRIBUTING.md)."""
    from jouleswarm.studies import written
    from jouleswarm.studies.lookup import Results

    found, of = pages or written.pages_in(Path()), Results(results)
    if check:
        written.check(found, of)
    else:
        _list(written.write(found, of))


def _command(name: StudyName) -> Callable[..., None]:
    def command(
        profile: ProfileOption = Profile.COMPACT,
        scenario: ScenarioChoice = None,
        set_: SetOption = None,
        seeds: Seeds = None,
        first_seed: FirstSeed = 1,
        more_seeds: MoreSeeds = 0,
        t0: T0 = None,
        methods: Methods = None,
        tuned: TunedOption = None,
        workers: Workers = _CORES,
        scheduler: Scheduler = None,
        work: Work = None,
        results: Results = None,
        keep: Keep = False,
        figures: Figures = DEFAULT,
    ) -> None:
        from jouleswarm.studies.catalogue import kind_of
        from jouleswarm.studies.jobs import Request, range_of_seeds
        from jouleswarm.studies.run import Where, run_study
        from jouleswarm.studies.tuned import read_tuned

        kind = kind_of(name)
        label = profile.value if scenario is None else scenario.stem
        own = range_of_seeds(kind.seeds if seeds is None else seeds, first_seed)
        if more_seeds and name != "paper":
            raise ConfigurationError(f"study {name}: got --more-seeds, which is of `study paper` alone; leave it out")
        request = Request(
            scenario_file=scenario or profile.scenario,
            overrides=tuple(set_ or ()),
            seeds=own,
            t0=kind.t0 if t0 is None else t0,
            methods=tuple(each.strip() for each in (methods or "").split(",") if each.strip()),
            tuned=read_tuned(tuned),
            more_seeds=range_of_seeds(more_seeds, own[-1] + 1) if more_seeds else (),
        )
        where = Where(
            work=work or Path("runs") / f"study-{name}-{label}",
            results=results or Path("results") / (label if name == "paper" else f"{label}-{name}"),
            workers=workers,
            scheduler=scheduler,
            keep=keep,
            kinds=figure_kinds(figures),
        )
        _list(run_study(kind, request, label, where, Console()))

    return command


def _list(paths: list[Path]) -> None:
    for path in paths:
        print(path)


for _name, _help in STUDIES.items():
    study.command(_name, help=_help)(_command(_name))
