"""The page's web server: on this machine alone, elsewhere only for who has the token."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import secrets
import socket
import sys
import threading
from collections.abc import AsyncIterator
from typing import Any

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.page.guard import guard
from jouleswarm.page.meter.source import MeterFolder
from jouleswarm.page.source import Source
from jouleswarm.page.watch import Watch

LOCAL_HOST, PORT = "127.0.0.1", 8050
_TRIED = 20


def check_installed() -> None:
    """See that NiceGUI can be had, before anything is started.

    Raises:
        ConfigurationError: it is not installed.
    """
    from importlib.util import find_spec

    if find_spec("nicegui") is None:
        raise ConfigurationError("the page needs NiceGUI, which is not installed: pip install jouleswarm[page]")


def listening(host: str, port: int | None) -> socket.socket:
    """A socket that listens: on `port`, else on the first free one from PORT on.

    Raises:
        ConfigurationError: there is none to be had.
    """
    wanted = [port] if port is not None else [*range(PORT, PORT + _TRIED), 0]
    for each in wanted:
        try:
            return socket.create_server((host, each), family=_family(host))
        except OSError as error:
            if each == wanted[-1]:
                raise ConfigurationError(
                    f"page: cannot listen on {host}, port {each}: {error.strerror or error}; name others with --listen "
                    "and --port"
                ) from error
    raise AssertionError


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def new_token(host: str) -> str | None:
    """A secret where others than this machine's users can come; None on a loopback address."""
    if host == "localhost":
        return None
    try:
        return None if ipaddress.ip_address(host).is_loopback else secrets.token_urlsafe(24)
    except ValueError:
        return secrets.token_urlsafe(24)


def url(host: str, port: int, token: str | None) -> str:
    """What a browser is to open."""
    shown = f"[{host}]" if ":" in host else socket.gethostname() if host in ("0.0.0.0", "") else host
    return f"http://{shown}:{port}/" + (f"?token={token}" if token else "")


def serve(source: Source[Any], sock: socket.socket, token: str | None, *, with_parent: bool = False) -> None:
    """Serve the page until Ctrl-C or SIGTERM; `with_parent`: and no longer than standard input is open.

    Args:
        source: of what is shown.
        sock: which listens.
        token: without it nobody is answered; None: who asks for this machine by its own names.
    """
    import uvicorn
    from fastapi import FastAPI
    from nicegui import ui

    logging.getLogger("nicegui").setLevel(logging.ERROR)
    watch = Watch(source)

    @contextlib.asynccontextmanager
    async def watching(_: FastAPI) -> AsyncIterator[None]:
        # Not before: NiceGUI looks through all objects as it starts, and CPython bears no other thread then.
        with watch:
            yield

    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=watching)
    ui.run_with(app, root=lambda: _open(source, watch), title=f"{source.title}: JouleSwarm", dark=None, tailwind=False)
    guarded = guard(app, token)
    config = uvicorn.Config(guarded, log_level="error", ws="wsproto", timeout_graceful_shutdown=1)
    server = uvicorn.Server(config)
    if with_parent:
        threading.Thread(target=_end_with_stdin, args=(server,), daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt):  # it is how a page ends
        server.run(sockets=[sock])


def _open(source: Source[Any], watch: Watch[Any]) -> None:
    from jouleswarm.page.meter.view import MeterView
    from jouleswarm.page.view import View

    (MeterView if isinstance(source, MeterFolder) else View)(watch)


def _end_with_stdin(server: Any) -> None:
    while os.read(sys.stdin.fileno(), 1024):
        pass
    server.should_exit = True
