"""What the broker had counted under a run's name before the run began: it is no part of the run's bill."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.meter import MeterRow

BASELINE = "baseline.json"
_COUNTS = ("messages", "payload_bytes", "packet_bytes")


def keep_baseline(file: Path, rows: Sequence[MeterRow]) -> None:
    """Remember what the broker had counted under the run's name before it began."""
    told = json.dumps([row.model_dump(mode="json") for row in rows])
    digest = hashlib.sha256(told.encode()).hexdigest()
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, f'{{"sha256": "{digest}", "rows": {told}}}\n'.encode())


def kept_baseline(file: Path) -> list[MeterRow] | None:
    """What `keep_baseline` remembered; None if it did not.

    Raises:
        RunError: the file is damaged.
    """
    if not file.exists():
        return None
    try:
        held = json.loads(file.read_bytes())
        if hashlib.sha256(json.dumps(held["rows"]).encode()).hexdigest() != held["sha256"]:
            raise ValueError("its checksum does not fit")
        return [MeterRow.model_validate(row) for row in held["rows"]]
    except (ValueError, KeyError, TypeError) as error:
        why = "a run cannot be gone on with that does not know what the broker had counted before it"
        raise RunError(f"{file}: damaged ({str(error).splitlines()[0]}); {why}") from error


def since(rows: Sequence[MeterRow], baseline: Sequence[MeterRow]) -> tuple[list[MeterRow], bool]:
    """What has been counted since the baseline, and whether any of its counts are gone: none ever falls.

    A count that has fallen began anew since then, so that all of it is of this run.
    """
    before = {(row.client, row.topic, row.direction): row for row in baseline}
    found: list[MeterRow] = []
    any_gone = False
    for row in rows:
        then = before.pop((row.client, row.topic, row.direction), None)
        counts = {name: getattr(row, name) - (getattr(then, name) if then else 0) for name in _COUNTS}
        if min(counts.values()) < 0:
            found.append(row)
            any_gone = True
        elif max(counts.values()) > 0:
            found.append(row.model_copy(update=counts))
    return found, any_gone or bool(before)
