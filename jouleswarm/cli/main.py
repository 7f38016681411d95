"""The command line: a file a group of commands, no logic."""

from __future__ import annotations

import typer

from jouleswarm.cli.bill import bill
from jouleswarm.cli.calibrate import calibrate
from jouleswarm.cli.chaos import chaos
from jouleswarm.cli.entry import command_line
from jouleswarm.cli.keys import keys
from jouleswarm.cli.meter import meter
from jouleswarm.cli.page import page
from jouleswarm.cli.report import audit, report
from jouleswarm.cli.run import record, run, validate
from jouleswarm.cli.study import study

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    help="What does a learning scheme cost in joules and bits? Runs it over a real MQTT bus and presents the bill.",
)
for command in (run, validate, record, report, page, bill, calibrate, chaos, audit):
    app.command()(command)
app.add_typer(keys, name="keys")
app.add_typer(meter, name="meter")
app.add_typer(study, name="study")


def main() -> None:
    """Entry point."""
    with command_line():
        app(prog_name="jouleswarm")


if __name__ == "__main__":
    main()
