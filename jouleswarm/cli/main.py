"""The command line: a file a group of commands, no logic."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from jouleswarm.cli.bill import bill
from jouleswarm.cli.calibrate import calibrate
from jouleswarm.cli.chaos import chaos
from jouleswarm.cli.doctor import doctor
from jouleswarm.cli.document import command_in_json, wants_json
from jouleswarm.cli.entry import command_line
from jouleswarm.cli.help import tell_whole_sentences
from jouleswarm.cli.keys import keys
from jouleswarm.cli.meter import meter
from jouleswarm.cli.page import page
from jouleswarm.cli.report import audit, report
from jouleswarm.cli.run import record, run, validate
from jouleswarm.cli.runs import compare, export, runs
from jouleswarm.cli.scenarios import init, scenarios, schema
from jouleswarm.cli.study import study

app = typer.Typer(
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    help="What does a learning scheme cost in joules and bits? Runs it over a real MQTT bus and presents the bill.",
)


def _version(is_asked: bool) -> None:
    if is_asked:
        from importlib.metadata import version

        print(f"jouleswarm {version('jouleswarm')}")
        raise typer.Exit


@app.callback()
def _whole(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


_COMMANDS = (
    *(scenarios, init, validate, run, record, page, runs, report, compare, export, bill),
    *(calibrate, audit, chaos, schema, doctor),
)
for command in _COMMANDS:
    app.command()(command)
app.add_typer(keys, name="keys")
app.add_typer(meter, name="meter")
app.add_typer(study, name="study")
tell_whole_sentences(app)


def main() -> None:
    """Entry point."""
    with command_line():
        if wants_json(sys.argv[1:]):
            command_in_json(app)
        else:
            app(prog_name="jouleswarm")


if __name__ == "__main__":
    main()
