"""`jouleswarm page`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def page(
    run_directory: Annotated[Path, typer.Argument(help="A run directory: finished, or of a run that goes on.")],
    listen: Annotated[
        str, typer.Option(help="Address to listen on; where others can come only with the token that is printed.")
    ] = "127.0.0.1",
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port to listen on; default the first free one from 8050 on.")
    ] = None,
) -> None:
    """Show a run in the browser, while it goes on or afterwards. Ctrl-C ends the page, never the run."""
    from jouleswarm.common.errors import ConfigurationError
    from jouleswarm.page.serve import check_installed, listening, new_token, serve, url
    from jouleswarm.page.source import Folder

    check_installed()
    if not run_directory.is_dir():
        raise ConfigurationError(f"run {run_directory}: no such directory; name the one that `jouleswarm run` printed")
    with listening(listen, port) as sock:
        token = new_token(listen)
        print(f"page: {url(listen, sock.getsockname()[1], token)} (Ctrl-C ends it)", flush=True)
        serve(Folder(run_directory), str(run_directory), sock, token)
