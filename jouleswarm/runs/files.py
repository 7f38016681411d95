"""The files of a run directory, each read and held against what it should be."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.scenario.documents import parse_json
from jouleswarm.runs.directory import MANIFEST, SUMMARY
from jouleswarm.runs.summary import SCHEMA

T = TypeVar("T", bound=BaseModel)

_STATUSES = ("complete", "interrupted", "failed")


def read_manifest(path: Path) -> dict[str, Any]:
    """The manifest of a run directory: of this version's schema, or as it is of a kind that has its own, a meter's.

    Raises:
        ConfigurationError: there is none: this is no run directory.
        RunError: it is damaged, or of another schema.
    """
    file = path / MANIFEST
    if not file.exists():
        told = f"has no {MANIFEST}; name one that `jouleswarm run` printed"
        raise ConfigurationError(f"{path} is not a run directory: {told}")
    manifest = read_json(file)
    if manifest.get("kind"):  # whose readers know what is in it
        return manifest
    if manifest.get("schema") != SCHEMA:
        other = other_version(manifest)
        raise RunError(f"{file}: {_other_schema(manifest.get('schema'))}" + (f" ({other})" if other else ""))
    for key, kind in (("run", str), ("scenario", dict)):
        if not isinstance(manifest.get(key), kind):
            raise RunError(f"{file}: damaged, it has no {key!r}")
    return manifest


def run_manifest(path: Path) -> dict[str, Any]:
    """The same of a run alone.

    Raises:
        ConfigurationError: it is of another kind.
        RunError: as `read_manifest`.
    """
    manifest = read_manifest(path)
    if kind := manifest.get("kind"):
        raise ConfigurationError(
            f"{path}: what a {kind} has counted, which has no rounds; expected what `jouleswarm run` or `record` wrote "
            "(`jouleswarm report`, `bill` and `meter watch` take it)"
        )
    return manifest


def other_version(manifest: dict[str, Any]) -> str | None:
    """Which version wrote a run directory and which one this is, if they differ."""
    versions, ours = manifest.get("versions"), importlib.metadata.version("jouleswarm")
    theirs = versions.get("jouleswarm") if isinstance(versions, dict) else None
    return None if theirs in (None, ours) else f"written by version {theirs} of JouleSwarm, this is {ours}"


def read_summary(file: Path) -> dict[str, Any] | None:
    summary = read_json(file) if file.exists() else None
    if summary is not None and summary.get("status") not in _STATUSES:
        raise RunError(f"{file}: damaged, its status is {summary.get('status')!r}, expected {', '.join(_STATUSES)}")
    return summary


def _other_schema(schema: object) -> str:
    if isinstance(schema, int) and schema < SCHEMA:
        return (
            f"run directory of schema {schema}, from before runs had an arm for each method; this version reads "
            f"{SCHEMA}: report it with the version it names under versions, or run its scenario again"
        )
    return f"run directory of schema {schema!r}, this version reads {SCHEMA}"


def read_json(file: Path) -> dict[str, Any]:
    try:
        found = parse_json(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RunError(f"{file}: cannot be read: {error}") from error
    if not isinstance(found, dict):
        raise RunError(f"{file}: damaged, expected a JSON object")
    return found


def read_lines(file: Path, model: type[T], needed: bool, cut: list[str] | None) -> list[T]:
    """Rows of a JSON-lines file. A torn last line is left out and told in `cut`; with None it is damage too."""
    if not file.exists():
        if needed:
            raise RunError(f"{file}: missing, though the run has a {SUMMARY}")
        return []
    try:
        lines = file.read_bytes().splitlines(keepends=True)
    except OSError as error:
        raise RunError(f"{file}: cannot be read: {error.strerror}") from error
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(model.model_validate_json(line))
        except ValidationError as error:
            if cut is not None and number == len(lines) and not line.endswith(b"\n"):
                cut.append(file.name)
                break
            raise RunError(f"{file}, line {number}: damaged: {error.errors()[0]['msg']}") from error
    return rows
