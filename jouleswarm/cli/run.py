"""`jouleswarm run` and `jouleswarm record`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from jouleswarm.cli.document import JsonOption, print_document
from jouleswarm.cli.followers import followed
from jouleswarm.cli.options import (
    SCENARIO,
    Details,
    Dry,
    Durable,
    EnergyFile,
    Figures,
    KeepState,
    Measured,
    MetricsHost,
    MetricsPort,
    Mlflow,
    NoFigures,
    Out,
    Restarts,
    Resume,
    Rounds,
    RunId,
    ScenarioFile,
    Scheduler,
    Seed,
    ShowPage,
    Tensorboard,
    overrides,
)
from jouleswarm.common.figure_kinds import DEFAULT, figure_kinds
from jouleswarm.common.options import BrokerOption, KeysOption, OtherProcessorOption, SetOption

_Broker = Annotated[
    str | None, typer.Option(envvar="JOULESWARM_BROKER", help="Use this broker (mqtt://...), not an embedded one.")
]
_Listen = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT",
        help="Where the embedded broker listens, by the address that its clients know it by; port 0: a free one; :PORT "
        "is every address. Default: where its own processes, and nobody else, reach it.",
    ),
]


def _present(path: Path, figures: Sequence[str], details: bool) -> None:
    from jouleswarm.fleet.stopping import telling_what_is_kept
    from jouleswarm.report.report import report as print_bill

    with telling_what_is_kept(path):
        typer.echo("all is recorded: pricing it" + (", then drawing figures and report.html" if figures else ""))
        print_bill(path, details=details, html=bool(figures), figures=figures)


def _check_given(
    scenario: Path | None, resume: Path | None, anew: Sequence[object], *, dry: bool, rounds: int | None
) -> None:
    """Whether options go together; `anew`: of those that are of a new run alone, what is given."""
    if (scenario is None) == (resume is None):
        raise typer.BadParameter("expected a scenario file, or --resume RUN_DIRECTORY, and not both")
    if (dry and scenario is None) or (rounds is not None and not dry):
        raise typer.BadParameter("--dry is of a scenario, and --rounds of --dry")
    if scenario is None and any(each is not None for each in anew):
        raise typer.BadParameter("--resume goes on with a run as begun: no --seed, --run-id, --energy or --measure")


def run(
    scenario: Annotated[Path | None, SCENARIO] = None,
    seed: Seed = None,
    set_: SetOption = None,
    energy: EnergyFile = None,
    measure: Measured = False,
    out: Out = Path("runs"),
    run_id: RunId = None,
    broker: _Broker = None,
    keys: KeysOption = None,
    scheduler: Scheduler = None,
    listen: _Listen = None,
    figures: Figures = DEFAULT,
    no_figures: NoFigures = False,
    resume: Resume = None,
    restarts: Restarts = 20,
    durable: Durable = False,
    other_processor: OtherProcessorOption = False,
    dry: Dry = False,
    rounds: Rounds = None,
    keep_state: KeepState = False,
    metrics_port: MetricsPort = None,
    tensorboard: Tensorboard = None,
    mlflow: Mlflow = None,
    details: Details = False,
    page: ShowPage = False,
) -> None:
    """Run a scenario: broker, data center and robots as processes, then the bill.

    All run on this machine, or all but the broker on the workers of a Dask cluster: --scheduler tcp://HOST:8786, with
    --out on a disk that all of them share (docs/distributed.md).
    Ctrl-C ends every process and leaves a readable run directory, which --resume goes on with. A complete one that was
    run with --keep-state goes on with more rounds: --resume RUN --set federation.max_rounds=80.
    """
    from jouleswarm.common.scenario.reading import energy_file, load_scenario
    from jouleswarm.fleet.deploy import Options, new_run_id, resume_deployment, run_deployment
    from jouleswarm.fleet.more_rounds import with_more_rounds
    from jouleswarm.report.view import View
    from jouleswarm.runs.files import read_manifest

    _check_given(scenario, resume, (seed, run_id, energy, measure or None), dry=dry, rounds=rounds)
    if scenario is not None and dry:
        validate(scenario, seed, set_, energy, rounds)
        return
    changes = [*energy_file(energy), *(["measure.energy=true"] if measure else ()), *overrides(set_, seed)]
    settings = None if scenario is None else load_scenario(scenario, changes)
    _ = resume and read_manifest(resume)
    from jouleswarm.page.beside import page_beside  # heavy

    name = "" if settings is None else run_id or new_run_id(settings)
    where = resume or out / name
    with page_beside(where, wanted=page), followed(metrics_port, tensorboard, mlflow) as also:
        given = broker, keys, restarts, durable, other_processor, keep_state
        started = Options(*given, view=also.beside(View), scheduler=scheduler, listen=listen)
        if settings is None:
            resume_deployment(where, Console(), started, with_more_rounds(where, set_) if set_ else None)
        else:
            run_deployment(settings, name, out, Console(), started)
        also.end(where)
        _present(where, () if no_figures else figure_kinds(figures), details)


def validate(
    scenario: ScenarioFile,
    seed: Seed = None,
    set_: SetOption = None,
    energy: EnergyFile = None,
    rounds: Rounds = None,
    as_json: JsonOption = False,
) -> None:
    """Check a scenario and all that it names, and print what a run of it will cost; as `run --dry`."""
    from jouleswarm.common.scenario.reading import energy_file, load_scenario

    settings = load_scenario(scenario, [*energy_file(energy), *overrides(set_, seed)])
    from jouleswarm.fleet.trial import try_out
    from jouleswarm.report.foretold import foretold_document, print_foretold

    try_out(settings)
    if as_json:
        print_document(foretold_document(settings, rounds))
    else:
        print_foretold(settings, rounds)


def record(
    scenario: ScenarioFile,
    broker: BrokerOption,
    seed: Seed = None,
    set_: SetOption = None,
    out: Out = Path("runs"),
    run_id: RunId = None,
    keys: KeysOption = None,
    ready_file: Annotated[
        Path | None, typer.Option(help="Write this file once the recorder listens, for a health check.")
    ] = None,
    figures: Figures = DEFAULT,
    no_figures: NoFigures = False,
    metrics_port: MetricsPort = None,
    metrics_host: MetricsHost = "127.0.0.1",
    tensorboard: Tensorboard = None,
    mlflow: Mlflow = None,
    details: Details = False,
) -> None:
    """Record a run whose processes are started by hand or by Docker Compose, then present the bill.

    Start it before the robots: what they report before it listens is lost. The run's name on the bus is
    --run-id (default: the scenario's name), as with the processes' --run.
    """
    from jouleswarm.common.scenario.reading import load_scenario
    from jouleswarm.fleet.recording import record_deployment
    from jouleswarm.report.view import View

    kinds = () if no_figures else figure_kinds(figures)
    settings = load_scenario(scenario, overrides(set_, seed))
    with followed(metrics_port, tensorboard, mlflow, metrics_host) as also:
        view, run_ = also.beside(View), run_id or settings.name
        path = record_deployment(settings, run_, out, broker, Console(), ready_file, keys, view)
        also.end(path)
        _present(path, kinds, details)
