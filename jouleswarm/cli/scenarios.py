"""`jouleswarm scenarios`, `jouleswarm init` and `jouleswarm schema`."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.cli.document import JsonOption, print_document
from jouleswarm.common.errors import ConfigurationError, usable
from jouleswarm.common.invoked import executable


def scenarios(as_json: JsonOption = False) -> None:
    """List the scenarios that come with the package, and those of the current folder."""
    from jouleswarm.common.scenario.shelf import on_shelf

    found = on_shelf(Path.cwd())
    if as_json:
        print_document({"scenarios": [each._asdict() for each in found]})
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column()
    for each in found:
        table.add_row(escape(each.name), escape(each.what))
    Console().print(table)


def init(
    file: Annotated[
        Path, typer.Argument(help="The file to write, which must not be there yet; its name is the scenario's.")
    ] = Path("scenario.toml"),
) -> None:
    """Write a scenario of your own: small, valid as it is, every field in it with its default and what it is."""
    from jouleswarm.common.scenario.documents import parse_toml
    from jouleswarm.common.scenario.reading import scenario_from
    from jouleswarm.common.scenario.template import template

    path = file if file.suffix else file.with_suffix(".toml")
    if path.suffix != ".toml":
        raise ConfigurationError(f"{path}: expected a file that ends in .toml")
    text = template(path.stem)
    scenario_from(parse_toml(text), str(path))  # as its name must be one that a run can have
    with usable("scenario", path):
        try:
            with path.open("x", encoding="utf-8") as written:
                written.write(text)
        except FileExistsError:
            raise ConfigurationError(f"{path} is there already; name another file") from None
    program, typed = executable(), shlex.quote(str(path))
    print(f"wrote {path}\nnext: {program} validate {typed}\n      {program} run {typed}")


def schema() -> None:
    """Print the JSON Schema of a scenario file, for an editor that completes and checks TOML.

    \b
    jouleswarm schema > scenario.schema.json
    Then, as the first line of your scenario, for taplo and Even Better TOML:
        #:schema ./scenario.schema.json
    """
    from jouleswarm.common.scenario.schema import schema as of_scenario

    print(json.dumps(of_scenario(), indent=2, ensure_ascii=False))
