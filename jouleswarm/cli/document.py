"""`--json`: one document on standard output and nothing else there, errors included (docs/exit_codes.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import typer

from jouleswarm.common.disk.trouble import full_disk_is_told
from jouleswarm.common.errors import JouleSwarmError, RunError, used_up
from jouleswarm.common.process import STOPPED

SCHEMA = 1
"""Of the documents: a higher one when a key goes or means something else; keys may be added."""

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document and nothing else, an error too (docs/exit_codes.md).")
]


def wants_json(arguments: Sequence[str]) -> bool:
    """Whether errors are to be JSON too, also those in the arguments themselves."""
    return "--json" in arguments


def print_document(content: Mapping[str, Any]) -> None:
    """Print what a command has found."""
    print(json.dumps(_plain({"schema": SCHEMA, **content}), indent=2, ensure_ascii=False, allow_nan=False))


def command_in_json(app: typer.Typer) -> None:
    """Run a command whose errors are documents; ends with its exit code. A defect keeps its traceback."""
    try:
        with full_disk_is_told():
            code = app(prog_name="jouleswarm", standalone_mode=False) or 0
    except JouleSwarmError as error:
        code = _print_error(error.kind, str(error), error.exit_code)
    except OSError as error:
        if (line := used_up(error)) is None:
            raise
        code = _print_error(RunError.kind, line, RunError.exit_code)
    except Exception as error:
        if not hasattr(error, "format_message"):  # Typer's own, of arguments
            raise
        code = _print_error("usage", error.format_message(), getattr(error, "exit_code", 2))
    if code == STOPPED:
        _print_error("stopped", "stopped", code)
    raise SystemExit(code)


def _print_error(kind: str, message: str, code: int) -> int:
    print_document({"error": {"kind": kind, "message": message, "exit_code": code}})
    return code


def _plain(value: Any) -> Any:
    """As JSON has it: numbers that are not finite are null, whatever is no plain value is its text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | bool | None) else str(value)
