"""`study.json`: what a study's facts were made with, beside them; no path and no date, so that it can be committed."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from jouleswarm.common.doors import DOORS
from jouleswarm.common.errors import ConfigurationError, StudyError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.prices import PriceList, price_lists
from jouleswarm.studies.files import write_atomically
from jouleswarm.studies.tuned import UNTUNED, Tuned

RECORD, MODEL_SUFFIX = "study.json", ".safetensors"


class Record(BaseModel):
    """The study, its scenario before variants and seeds, and what tables need beside facts."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    study: str
    profile: str
    scenario: Scenario
    seeds: tuple[int, ...]
    t0: int
    """Rounds of meta-training that the study is about, where it is about one."""
    groups: dict[str, dict[str, str]] = Field(default_factory=dict)
    """What was varied -> its value -> the variant of facts.csv that has it; a figure each."""
    values: dict[str, dict[int, float]] = Field(default_factory=dict)
    """Variant -> seed -> what was computed of its scenario before it ran (similarity, say)."""

    training: dict[str, tuple[int, ...]] = Field(default_factory=dict)
    """Variant -> tasks of its meta-training, where these are other ones than the scenario's."""

    more_seeds: tuple[int, ...] = ()
    """Beside `seeds`, of `t0` and without transfer alone."""
    tuned: Tuned = UNTUNED
    """Settings of single methods, which `scenario` need not have."""

    def seen(self, variant: str) -> tuple[int, ...]:
        """Tasks that meta-training has seen."""
        return self.training.get(variant, self.scenario.meta.training_tasks)

    @property
    def lists(self) -> tuple[PriceList, ...]:
        """The scenario's price lists."""
        return price_lists(self.scenario)


def write_record(folder: Path, record: Record) -> None:
    """Write `study.json`, and in `doors/` the user's files that reading it back needs: all that the scenario names but
    models.

    Raises:
        StudyError: it cannot be written.
    """
    for name, path in record.scenario.files.items():
        if path.suffix != MODEL_SUFFIX:
            write_atomically(folder / DOORS / name, path.read_bytes())
    write_atomically(folder / RECORD, record.model_dump_json(indent=2) + "\n")


def read_record(folder: Path) -> Record:
    """Read `study.json` back.

    Raises:
        ConfigurationError: there is none: this is no results folder of a study.
        StudyError: it is damaged.
    """
    path = folder / RECORD
    try:
        return Record.model_validate_json(path.read_bytes(), context={"folder": folder / DOORS, "stored": True})
    except OSError as error:
        told = f"cannot be read ({error.strerror}); name a results folder of a study"
        raise ConfigurationError(f"{path}: {told}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(level) for level in first["loc"])
        raise StudyError(f"{path}: damaged at {where}: {first['msg']}; run the study again") from error
