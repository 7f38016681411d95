"""The command line: `jouleswarm run`, `record`, `report`, `audit`; `keys` is in keys_cli.py."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from common.options import BrokerOption, KeysOption, OtherProcessorOption, SetOption
from fleet.entry import command_line
from fleet.keys_cli import keys as keys_app

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    help="What does a learning scheme cost in joules and bits? Runs it over a real MQTT bus and presents the bill.",
)
app.add_typer(keys_app, name="keys")

ScenarioFile = Annotated[
    Path, typer.Argument(envvar="JOULESWARM_SCENARIO", help="Scenario file (TOML), for example scenarios/quick.toml.")
]
Seed = Annotated[int | None, typer.Option(help="Seed in place of the scenario's.")]
Out = Annotated[Path, typer.Option(envvar="JOULESWARM_OUT", help="Folder for run directories.")]
RunId = Annotated[str | None, typer.Option(envvar="JOULESWARM_RUN", help="Name of the run and of its directory.")]


def _present(path: Path, figures: bool) -> None:
    from fleet.report import report as print_bill
    from fleet.stopping import telling_what_is_kept

    with telling_what_is_kept(path):
        print_bill(path, html=figures, figures=figures)
        print(f"run directory: {path}")


def _overrides(set_: list[str] | None, seed: int | None) -> list[str]:
    return [*(set_ or ()), *([f"seed={seed}"] if seed is not None else ())]


@app.command()
def run(
    scenario: Annotated[
        Path | None,
        typer.Argument(envvar="JOULESWARM_SCENARIO", help="Scenario file (TOML), for example scenarios/quick.toml."),
    ] = None,
    seed: Seed = None,
    set_: SetOption = None,
    out: Out = Path("runs"),
    run_id: RunId = None,
    broker: Annotated[
        str | None, typer.Option(envvar="JOULESWARM_BROKER", help="Use this broker (mqtt://...), not an embedded one.")
    ] = None,
    keys: KeysOption = None,
    figures: Annotated[bool, typer.Option(help="Draw figures and write report.html at the end.")] = True,
    resume: Annotated[
        Path | None,
        typer.Option(help="In place of a scenario: go on with this run directory, from where it was interrupted."),
    ] = None,
    restarts: Annotated[
        int, typer.Option(min=0, help="How often each process that was killed is started again, to the same end.")
    ] = 20,
    durable: Annotated[
        bool,
        typer.Option("--durable", help="Have each round on the disk: --resume works after a power failure too."),
    ] = False,
    other_processor: OtherProcessorOption = False,
) -> None:
    """Run a scenario on this machine: broker, data center and robots as processes, then the bill.

    Ctrl-C ends every process and leaves a readable run directory, which --resume goes on with.
    """
    from common.scenario import load_scenario
    from fleet.run import Options, new_run_id, resume_deployment, run_deployment

    started = Options(broker, keys, restarts, durable, other_processor)
    if (scenario is None) == (resume is None):
        raise typer.BadParameter("expected a scenario file, or --resume RUN_DIRECTORY, and not both")
    if scenario is None:
        assert resume is not None
        if set_ or seed is not None or run_id is not None:
            raise typer.BadParameter("--resume goes on with a run as it was begun: no --set, --seed or --run-id")
        _present(resume_deployment(resume, Console(), started), figures)
        return
    overrides = _overrides(set_, seed)
    settings = load_scenario(scenario, overrides)
    _present(run_deployment(settings, run_id or new_run_id(settings), out, Console(), started), figures)


@app.command()
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
    figures: Annotated[bool, typer.Option(help="Draw figures and write report.html at the end.")] = True,
) -> None:
    """Record a run whose processes are started by hand or by Docker Compose, then present the bill.

    Start it before the robots: what they report before it listens is lost. The run's name on the bus is
    --run-id (default: the scenario's name), as with the processes' --run.
    """
    from common.scenario import load_scenario
    from fleet.run import record_deployment

    settings = load_scenario(scenario, _overrides(set_, seed))
    path = record_deployment(settings, run_id or settings.name, out, broker, Console(), ready_file, keys)
    _present(path, figures)


@app.command()
def report(
    run_directory: Annotated[Path, typer.Argument(help="A run directory.")],
    ul: Annotated[float | None, typer.Option(help="Uplink efficiency, kb/J.")] = None,
    sl: Annotated[float | None, typer.Option(help="Sidelink efficiency, kb/J.")] = None,
    dl: Annotated[float | None, typer.Option(help="Downlink efficiency, kb/J.")] = None,
    pue: Annotated[float | None, typer.Option(help="Power usage effectiveness of the data center.")] = None,
    beta: Annotated[
        str | None,
        typer.Option(metavar="FLOAT|measured", help="Cost of an exact meta-gradient over a first-order one."),
    ] = None,
    carbon_datacenter: Annotated[
        float | None, typer.Option(help="Carbon intensity where the data center is, gCO2e a kWh.")
    ] = None,
    carbon_robots: Annotated[
        float | None, typer.Option(help="Carbon intensity where the robots are charged, gCO2e a kWh.")
    ] = None,
    via_base_station: Annotated[bool, typer.Option(help="Sidelinks go up to the base station and down.")] = False,
    figures: Annotated[bool, typer.Option(help="Draw figures and write an HTML report again.")] = False,
) -> None:
    """Price a finished run again, at other efficiencies or in gCO2e. Nothing is trained again; its files stay."""
    from fleet.prices import Prices, parse_beta
    from fleet.report import report as print_bill

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
    print_bill(run_directory, prices, html=figures, figures=figures)


@app.command()
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

    Example: jouleswarm chaos scenarios/toy.toml --faults 100 --seed 1
    """
    import typing

    from common.scenario import load_scenario
    from fleet.chaos import CSV, run_chaos, wrapping
    from fleet.chaos_table import chaos_table
    from fleet.faults import KINDS, FaultKind

    unknown = [each for each in kind or () if each not in KINDS]
    if unknown:
        raise typer.BadParameter(f"got {', '.join(unknown)}, expected some of: {', '.join(KINDS)}")
    chosen = typing.cast("list[FaultKind]", kind) or KINDS
    # A broker may be away for longer than in a run that nobody disturbs.
    overrides = [f"bus.connect_timeout_s={max(60.0, 4 * pause_s)}", "bus.resend_after_s=3"]
    overrides += [*wrapping(load_scenario(scenario, set_ or ())), *(set_ or ())]
    settings = load_scenario(scenario, overrides)
    options = ["--scenario", str(scenario.resolve()), *(part for each in overrides for part in ("--set", each))]
    console = Console()
    done = run_chaos(settings, options, out, faults, seed, pause_s, chosen, console)
    console.print(chaos_table(done))
    console.print(f"as CSV: {out / CSV}", highlight=False)
    if len(done) < faults:
        missing = f"{faults - len(done)} of {faults} faults were not injected"
        console.print(f"{missing}: the runs were over before their phase; use a longer scenario", highlight=False)
    if len(done) < faults or not all(fault.is_survived for fault in done):
        raise typer.Exit(1)


@app.command()
def audit() -> None:
    """Print the paper's published figures beside what its equations and constants give."""
    from fleet.audit import print_audit

    print_audit()


def main() -> None:
    """Entry point."""
    with command_line():
        app(prog_name="jouleswarm")


if __name__ == "__main__":
    main()
