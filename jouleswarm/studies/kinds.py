"""What every study is made of: a plan of jobs, and tables and figures from their facts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure

from jouleswarm.common.errors import StudyError, usable
from jouleswarm.common.figure_kinds import KINDS
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.report.figures import save_figure
from jouleswarm.report.table import Table, csv_text, markdown_text
from jouleswarm.studies.arms import ran_away_note, told_apart
from jouleswarm.studies.curves import curves_csv, curves_of
from jouleswarm.studies.curves_figures import by_method, curves_figures
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.files import write_atomically
from jouleswarm.studies.jobs import Job, Request
from jouleswarm.studies.names import StudyName
from jouleswarm.studies.prices import with_motions
from jouleswarm.studies.record import Record
from jouleswarm.studies.uncertain import uncertain_csv, uncertain_markdown, uncertain_rows
from jouleswarm.studies.why import against_plain, why_csv, why_figures, why_markdown

_PNG_DPI = 200


@dataclass(frozen=True)
class Outputs:
    """Tables and figures by the name of their file."""

    csv: dict[str, Table]
    markdown: dict[str, list[Table]]
    figures: dict[str, Callable[[], Figure]] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """What a study runs; `settings` are those of all its jobs, `groups`, `values` and `training` see `Record`."""

    jobs: list[Job]
    settings: list[str]
    groups: dict[str, dict[str, str]] = field(default_factory=dict)
    values: dict[str, dict[int, float]] = field(default_factory=dict)
    training: dict[str, tuple[int, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Kind:
    """A study. To add one, write `plan` and `tables` and name it in `studies.catalogue`."""

    name: StudyName
    seeds: int
    t0: int
    plan: Callable[[Request], Plan]
    tables: Callable[[Sequence[Fact], Record], Outputs]
    """From facts with their motions."""

    def outputs(self, facts: Sequence[Fact], record: Record) -> Outputs:
        """Tables and figures of facts as they were read: the study's own, then what every study has: curves, what the
        bills hang on beside that without transfer and, where constants are ranges, what that comes to."""
        held, energy = as_told(facts, record.scenario), record.scenario.energy
        made = self.tables(held, record)
        if note := ran_away_note(held):
            for name, (first, *others) in list(made.markdown.items()):
                made.markdown[name] = [first._replace(notes=(*first.notes, note)), *others]
        curves = curves_of(held, record.scenario)
        made.csv["curves"] = curves_csv(curves)
        for name, shown in by_method(curves).items():
            drawn = curves_figures(shown, record.groups)
            made.figures.update({f"{each}{name}": draw for each, draw in drawn.items()})
        if pairs := against_plain(held, record.scenario):
            made.csv["why"] = why_csv(pairs, energy)
            made.markdown["why"] = why_markdown(pairs, energy)
            made.figures.update(why_figures(pairs, energy))
        if rows := uncertain_rows(held, energy, record.lists):
            made.csv["uncertain"] = uncertain_csv(rows)
            made.markdown["uncertain"] = [uncertain_markdown(rows, energy)]
        return made


def as_told(facts: Sequence[Fact], scenario: Scenario) -> list[Fact]:
    """Facts as they were read, with their motions, and with arms that each have one t0: what all tables are made of."""
    return told_apart(with_motions(facts, scenario))


def write_csv_tables(folder: Path, outputs: Outputs) -> list[Path]:
    """Write the tables for programs; the same facts make the same bytes."""
    return [_write(folder / f"{name}.csv", csv_text(table)) for name, table in outputs.csv.items()]


def write_outputs(folder: Path, outputs: Outputs, kinds: Sequence[str] = KINDS) -> list[Path]:
    """Write all tables and draw all figures; returns the paths.

    Raises:
        StudyError: a file cannot be written.
    """
    written = write_csv_tables(folder, outputs)
    written += [_write(folder / f"{name}.md", markdown_text(held)) for name, held in outputs.markdown.items()]
    with usable("--results", folder, StudyError):
        drawn = (save_figure(folder, name, draw, kinds, _PNG_DPI) for name, draw in outputs.figures.items())
        return written + [path for paths in drawn for path in paths]


def _write(path: Path, text: str) -> Path:
    write_atomically(path, text)
    return path
