"""Whether what is to be gone on from is as it was written, seen before anything starts."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from jouleswarm.common.disk.lines import whole_lines
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.counters import KEYS, read_counters
from jouleswarm.common.wire.rows import RoundRow

ROWS = "rounds.jsonl"
_STATES = ("state.[01]", "task-*.[01]", "end-*.[01]", "seals.[01]")


def check_states(folder: Path) -> None:
    """Every state in a folder and below, the files that each relies on, and all counters.

    Raises:
        RunError: something is not as it was written; names it.
    """
    for path in sorted({path.with_suffix("") for name in _STATES for path in folder.rglob(name)}):
        StateFile(path, None).load()
    for keys in sorted(folder.rglob(KEYS)):
        read_counters(keys.parent)
    for rows in sorted(folder.rglob(ROWS)):  # of a stage that is over no state seals them any more
        _check_rows(rows)


def _check_rows(path: Path) -> None:
    for number, line in enumerate(whole_lines(path, mend=False), start=1):
        try:
            RoundRow.model_validate_json(line)
        except ValidationError as error:
            told = error.errors(include_url=False)[0]["msg"]
            raise RunError(f"{path}, line {number}: not as it was written ({told}); begin the run anew") from error
