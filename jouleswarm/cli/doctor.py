"""`jouleswarm doctor`."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Mapping
from typing import Annotated

import typer

from jouleswarm.cli.document import JsonOption, print_document
from jouleswarm.common.options import KeysOption


def doctor(
    broker: Annotated[
        str | None, typer.Option(envvar="JOULESWARM_BROKER", help="Try whether this broker answers: mqtt://HOST:PORT.")
    ] = None,
    keys: KeysOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say what this machine has for JouleSwarm, to be pasted into a bug report.

    Versions, processor, memory, disk, ports, Docker, a broker, and what joules can be measured. No name of a user or a
    host is in it, nor a broker's address. Nothing is started or written.
    """
    from jouleswarm.fleet.doctor import broker_finding, findings

    found = findings()
    if not as_json:
        _print(found)
    asked = {} if broker is None else {"broker": broker_finding(broker, keys)}
    if as_json:
        print_document({"findings": {**found, **asked}})
    else:
        _print(asked)


def _print(found: Mapping[str, str]) -> None:
    for what, told in found.items():
        width = max(40, shutil.get_terminal_size().columns - 1)
        print(textwrap.fill(f"{what + ':':<14}{told}", width, subsequent_indent=" " * 14, break_on_hyphens=False))
