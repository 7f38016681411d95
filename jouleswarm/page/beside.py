"""The page of a run that is just being started: in a process of its own, which can neither slow nor end the run."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path

from jouleswarm.fleet.packages import command_of
from jouleswarm.page.serve import LOCAL_HOST, check_installed, listening, url

_GRACE_S = 3.0


@contextlib.contextmanager
def page_beside(run: Path, *, wanted: bool) -> Iterator[None]:
    """The page is there while the body runs, and after a body that ends well until Ctrl-C.

    Raises:
        ConfigurationError: it cannot be had; the body has not begun.
    """
    if not wanted:
        yield
        return
    check_installed()
    with listening(LOCAL_HOST, None) as sock:
        address = url(LOCAL_HOST, sock.getsockname()[1], None)
        print(f"page: {address}", flush=True)
        child = subprocess.Popen(
            [*command_of("jouleswarm.page"), str(run), str(sock.fileno())],
            stdin=subprocess.PIPE,
            pass_fds=[sock.fileno()],
            start_new_session=True,  # Ctrl-C is the run's: it ends the page once it has ended itself
        )
    try:
        yield
        print(f"the page stays at {address} until Ctrl-C", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            code = child.wait()
            print(f"the page has ended with exit code {code}; `jouleswarm page {run}` shows it again", flush=True)
    finally:
        _end(child)


def _end(child: subprocess.Popen[bytes]) -> None:
    child.terminate()
    try:
        child.wait(_GRACE_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
    assert child.stdin is not None
    child.stdin.close()
