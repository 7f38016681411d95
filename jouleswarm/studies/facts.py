"""Facts: what one stage of one arm of one run did. Counts only; every price comes later."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from jouleswarm.common.errors import ConfigurationError, StudyError
from jouleswarm.energy.facts import Counts
from jouleswarm.report.table import Table, csv_text
from jouleswarm.studies.files import number_text, write_atomically

_COUNTED = tuple(each.name for each in fields(Counts))
META_STAGE = 0
"""The `task` of the shared meta-learning stage in the data center."""


class Fact(BaseModel):
    """A row of `facts.csv`: the meta-learning stage of an arm (task 0) or one task's own stage."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    variant: str
    """What the study varied, "" where it varies nothing but the seed."""
    seed: int
    arm: str
    method: str
    t0: int
    """Rounds of meta-training behind the model that robots start from; 0 without."""
    task: int
    robots: int
    """Of the cluster; of task 0, those that the meta-model goes down to."""
    links: int
    """Directed neighbour links of the cluster; 0 in methods without sidelinks."""
    rounds: int
    """t_i by the scenario's own reward window; of task 0, t0. A task that was not learned ran to max_rounds."""
    rounds_first: int
    """First round in which the cluster's mean reward reached the target; `rounds` if none did."""
    rounds_w3: int
    """The same of rewards averaged over the last 3 rounds."""
    learned: bool
    reward: float | None
    rmse_m: float | None
    gradients_support: float
    gradients_query: float
    gradients_robots: float
    uplink_bytes: float
    downlink_bytes: float
    sidelink_bytes: float
    sidelink_sent_bytes: float
    seconds: float
    """Wall-clock time of the stage: of its slowest robot, or of the data center."""
    processor: str = ""
    """What it was computed on (see `common.host`); "" in facts from before that was noted."""
    motions: float | None = None
    """Of all robots, to learn from; None in facts from before that was noted (see `prices.with_motions`)."""
    evaluation_motions: float | None = None
    """Of greedy episodes; None where they were not counted."""
    beta: float | None = None
    """Of the stage: beta of eq. (9) as it was measured, 1 where no gradient goes through one; None: it was not."""

    rewards: str = ""
    """R after each round from 0 on, with spaces between; "" of a stage, and in facts from before that was noted."""

    ran_away: int = 0
    """Robots' rounds, round 0 among them, on values beyond any return (see `RoundRow.ran_away`); 0 of a stage, and in
    facts from before that was noted."""

    @property
    def counts(self) -> Counts:
        """What is priced."""
        return Counts(*[getattr(self, name) or 0 for name in _COUNTED])


COLUMNS = tuple(Fact.model_fields)
_FIRST = COLUMNS.index("processor")
"""Facts from before one of these columns was noted end somewhere behind this many."""
_TEXTS = ("variant", "processor", "rewards")


def write_facts(path: Path, facts: Iterable[Fact]) -> None:
    """Write facts as CSV, whole or not at all.

    Raises:
        StudyError: the file cannot be written.
    """
    rows = [[number_text(value) for value in fact.model_dump().values()] for fact in facts]
    write_atomically(path, csv_text(Table("", COLUMNS, rows)))


def read_facts(path: Path) -> list[Fact]:
    """Read facts back.

    Raises:
        ConfigurationError: there is no such file.
        StudyError: it is no CSV, has other columns, or a row that is not a fact.
    """
    try:
        rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
    except OSError as error:
        told = f"cannot be read ({error.strerror}); name the results folder of a study"
        raise ConfigurationError(f"{path}: {told}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise StudyError(f"{path}: cannot be read ({error}); expected the facts.csv of a study") from error
    columns = COLUMNS[: max(len(rows[0]), _FIRST)] if rows else COLUMNS
    if not rows or tuple(rows[0]) != columns:
        got = ",".join(rows[0]) if rows else "an empty file"
        raise StudyError(f"{path}: got {got}, expected the columns {','.join(COLUMNS)}; run the study again")
    return [_fact(columns, row, f"{path}, line {number}") for number, row in enumerate(rows[1:], start=2)]


def processors_note(facts: Iterable[Fact]) -> str | None:
    """What to know of facts that were not all computed on the same; None where they were."""
    found = sorted({fact.processor for fact in facts})
    if len(found) < 2:
        return None
    told = "; ".join(name or "not noted" for name in found)
    return f"facts were computed on {len(found)} kinds of processor ({told}): run again on one, some may be others"


def _fact(columns: Sequence[str], row: list[str], where: str) -> Fact:
    if len(row) != len(columns):
        raise StudyError(f"{where}: {len(row)} cells, expected {len(columns)}; delete the file and run the study again")
    # Only text may be empty; any other empty cell is a value that is not known.
    cells = {name: cell if cell or name in _TEXTS else None for name, cell in zip(columns, row, strict=True)}
    try:
        return Fact.model_validate(cells)
    except ValidationError as error:
        first = error.errors()[0]
        raise StudyError(f"{where}: {first['loc'][0]}: {first['msg']}, got {first['input']!r}") from error
