"""`jouleswarm page`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jouleswarm.cli.options import RunId, Seed, overrides
from jouleswarm.common.options import KeysOption, SetOption

if TYPE_CHECKING:
    from jouleswarm.page.source import Source


def page(
    run: Annotated[
        Path, typer.Argument(help="A run directory, also a meter's, finished or growing; with --broker the scenario.")
    ],
    broker: Annotated[
        str | None,
        typer.Option(help="Listen to a deployment elsewhere on its broker (mqtt://...), not to a directory."),
    ] = None,
    run_id: RunId = None,
    keys: KeysOption = None,
    seed: Seed = None,
    set_: SetOption = None,
    listen: Annotated[
        str, typer.Option(help="Address to listen on; where others can come only with the token that is printed.")
    ] = "127.0.0.1",
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port to listen on; default the first free one from 8050 on.")
    ] = None,
) -> None:
    """Show a run in the browser, while it goes on or afterwards. Ctrl-C ends the page, never the run."""
    from jouleswarm.page.serve import check_installed, listening, new_token, serve, url

    check_installed()
    source = _directory(run) if broker is None else _deployment(run, broker, run_id, keys, overrides(set_, seed))
    with listening(listen, port) as sock:
        token = new_token(listen)
        print(f"page: {url(listen, sock.getsockname()[1], token)} (Ctrl-C ends it)", flush=True)
        serve(source, sock, token)


def _directory(run: Path) -> Source[Any]:
    from jouleswarm.common.disk.lock import is_held
    from jouleswarm.common.errors import ConfigurationError
    from jouleswarm.metering.metered import is_metered
    from jouleswarm.page.meter.source import MeterFolder
    from jouleswarm.page.source import Folder
    from jouleswarm.runs.files import run_manifest

    if not run.is_dir():
        raise ConfigurationError(f"run {run}: no such directory; name the one that `jouleswarm run` printed")
    if is_metered(run):
        return MeterFolder(run)
    if not is_held(run):  # else it may be just beginning
        run_manifest(run)
    return Folder(run)


def _deployment(scenario: Path, broker: str, run_id: str | None, keys: Path | None, changes: list[str]) -> Source[Any]:
    from jouleswarm.common.scenario.reading import load_scenario
    from jouleswarm.page.listening import Deployment

    settings = load_scenario(scenario, changes)
    return Deployment.connect(broker, settings, run_id or settings.name, keys)
