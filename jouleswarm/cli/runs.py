"""`jouleswarm runs`, `jouleswarm compare` and `jouleswarm export`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jouleswarm.cli.document import JsonOption, print_document
from jouleswarm.cli.options import EnergyOption
from jouleswarm.common.invoked import executable

if TYPE_CHECKING:
    from jouleswarm.common.scenario.reading import Override


class Target(StrEnum):
    """What a run is exported to."""

    CSV = "csv"
    PARQUET = "parquet"
    TENSORBOARD = "tensorboard"
    MLFLOW = "mlflow"


def runs(
    folder: Annotated[Path, typer.Argument(envvar="JOULESWARM_OUT", help="Where runs were written to.")] = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """List the runs of a folder: finished, interrupted, running; rounds and joules of each arm.

    An interrupted one goes on by `jouleswarm run --resume RUN`.
    """
    from jouleswarm.runs.listing import listed

    found = listed(folder)
    from jouleswarm.report.listing import runs_document, runs_table

    if as_json:
        print_document({"runs": runs_document(found)})
        return
    from rich.console import Console

    from jouleswarm.report.table import show

    if found:
        show(runs_table(found, datetime.now(UTC)), Console())
        for each in found:
            if each.why:
                print(f"{each.path.name}: {each.why}")
    else:
        print(f"no runs in {folder}; make one: {executable()} run toy --out {shlex.quote(str(folder))}")


def compare(
    run_directories: Annotated[list[Path], typer.Argument(metavar="RUN RUN...", help="Two run directories or more.")],
    set_: EnergyOption = None,
    as_json: JsonOption = False,
) -> None:
    """Put runs side by side: rounds, joules, bits and seconds of each arm, and in what their scenarios differ.

    Of directories of `jouleswarm meter`: bytes, messages and joules by link, and in what rules and prices differ.
    """
    from jouleswarm.runs.files import read_manifest

    kinds = [read_manifest(each).get("kind") for each in run_directories]  # before anything heavy is loaded
    if all(kinds):
        _compare_meters(run_directories, set_ or (), as_json)
        return
    from rich.console import Console

    from jouleswarm.report.compare import compare_document, compare_lines, compare_table, compared
    from jouleswarm.report.table import show

    found = compared(run_directories, set_ or ())
    if as_json:
        print_document(compare_document(found))
        return
    show(compare_table(found), Console())
    for line in compare_lines(found):
        print(line)


def _compare_meters(folders: list[Path], changes: Sequence[Override], as_json: bool) -> None:
    from rich.console import Console

    from jouleswarm.report.compare_meters import compared_meters, meters_document, meters_lines, meters_table
    from jouleswarm.report.table import show

    found = compared_meters(folders, changes)
    if as_json:
        print_document(meters_document(found))
        return
    show(meters_table(found), Console())
    for line in meters_lines(found):
        print(line)


def export(
    run_directory: Annotated[Path, typer.Argument(metavar="RUN", help="A run directory.")],
    to: Annotated[Target, typer.Option(help="What for.")],
    out: Annotated[Path, typer.Option(help="Folder for a folder of the run's name; not for mlflow.")] = Path("export"),
    uri: Annotated[
        str | None, typer.Option(help="MLflow's tracking server or database. Default: mlflow.db here, as MLflow's own.")
    ] = None,
) -> None:
    """Hand a run over to other tools: tables as CSV or Parquet, TensorBoard's event files, or MLflow.

    \b
    jouleswarm export runs/RUN --to csv             # export/RUN/rounds.csv, ...
    jouleswarm export runs/RUN --to tensorboard
    tensorboard --logdir export
    jouleswarm export runs/RUN --to mlflow
    mlflow ui --backend-store-uri sqlite:///mlflow.db

    The run directory stays as it is; of one of `jouleswarm meter` there are tables only. Parquet, TensorBoard and
    MLflow are extras: pip install jouleswarm[export], [tensorboard], [mlflow].
    """
    folder = out / run_directory.resolve().name
    if to in (Target.CSV, Target.PARQUET):
        from jouleswarm.report.opened import load

        found = load(run_directory)
        from jouleswarm.report.exported import write_tables  # heavy

        for path in write_tables(found, folder, "parquet" if to is Target.PARQUET else "csv"):
            print(f"wrote {path}")
        return
    from jouleswarm.runs.run import load_run

    run = load_run(run_directory)
    if to is Target.MLFLOW:
        from jouleswarm.report.mlflow import log_run

        for name in log_run(run, uri or "sqlite:///mlflow.db"):
            print(f"logged {name}")
        return
    from jouleswarm.report.tensorboard import write_events

    for path in write_events(run, folder):
        print(f"wrote {path}")
