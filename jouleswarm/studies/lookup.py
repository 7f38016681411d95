"""Numbers of results by name: lines of committed tables, of tables at other prices, of `study.json` and of notes."""

from __future__ import annotations

import csv
import io
import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

from jouleswarm.common.errors import ConfigurationError, StudyError
from jouleswarm.report.table import csv_text
from jouleswarm.studies.record import Record, read_record
from jouleswarm.studies.repriced import table_at

Value = float | str | bool | None
NOTES = "notes.toml"


class Row:
    """A line of a table, whose columns are asked for by name."""

    def __init__(self, cells: dict[str, str], where: str) -> None:
        """`where`: the table and the line, for errors."""
        self._cells, self._where = cells, where

    def __getitem__(self, column: str) -> Value:
        """A number where it is one, None where the cell is empty.

        Raises:
            StudyError: there is no such column.
        """
        if column not in self._cells:
            raise StudyError(f"{self._where}: no column {column!r}, expected one of {', '.join(self._cells)}")
        return _value(self._cells[column])


class Results:
    """A folder of results, one folder a study."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._table = cache(self._read)

    def rows(self, table: str, at: str | Sequence[str] = (), **keys: object) -> list[Row]:
        """Lines of a table, in its order.

        Args:
            table: `STUDY/TABLE`, a CSV file without its ending.
            at: other prices, `energy.key=value`; the table is then made again from the study's facts.
            keys: what columns are to hold, a value or a list of such; "" is an empty cell.

        Raises:
            ConfigurationError: there is no such table, or a change of no price.
            StudyError: a column that there is not, or no line that holds this.
        """
        found = self._table(table, (at,) if isinstance(at, str) else tuple(at))
        for column, wanted in keys.items():
            held = [row[column] for row in found]
            found = [row for row, value in zip(found, held, strict=True) if _is_one_of(value, wanted)]
            if not found:
                told = ", ".join(dict.fromkeys(_text(value) for value in held))
                raise StudyError(f"{self._folder / table}.csv: no line with {_said(keys)}; of {column} there is {told}")
        return found

    def row(self, table: str, at: str | Sequence[str] = (), **keys: object) -> Row:
        """The one line of a table that holds this; see `rows`.

        Raises:
            StudyError: there are several.
        """
        found = self.rows(table, at, **keys)
        if len(found) > 1:
            raise StudyError(
                f"{self._folder / table}.csv: {len(found)} lines with {_said(keys) or 'anything'}, expected one; say "
                f"which by {', '.join(self._differing(found))}"
            )
        return found[0]

    def study(self, name: str) -> Record:
        """What a study was made with: its scenario, seeds and t0.

        Raises:
            ConfigurationError: there is no such study.
        """
        return read_record(self._folder / name)

    def note(self, *keys: str) -> object:
        """What stands in no table: a value of `notes.toml`, by its table and key.

        Raises:
            ConfigurationError: there is no such file or key.
        """
        path = self._folder / NOTES
        try:
            held: object = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, tomllib.TOMLDecodeError) as error:
            raise ConfigurationError(f"{path}: cannot be read ({error}); expected notes of results, as TOML") from error
        for key in keys:
            if not isinstance(held, dict) or key not in held:
                there = ", ".join(held) if isinstance(held, dict) else "a value"
                raise ConfigurationError(f"{path}: no {'.'.join(keys)}, expected {there} in place of {key}")
            held = held[key]
        return held

    def _read(self, table: str, at: tuple[str, ...]) -> list[Row]:
        path, folder = self._folder / f"{table}.csv", self._folder / Path(table).parent
        if at:
            text = csv_text(table_at(folder, at, path.stem))
        else:
            try:
                text = path.read_text(encoding="utf-8")
            except OSError as error:
                there = ", ".join(sorted(each.stem for each in folder.glob("*.csv"))) or "no table at all"
                raise ConfigurationError(f"{path}: cannot be read ({error.strerror}); {folder} has {there}") from error
        lines = csv.DictReader(io.StringIO(text))
        return [Row(cells, f"{path}, line {number}") for number, cells in enumerate(lines, start=2)]

    @staticmethod
    def _differing(found: Sequence[Row]) -> Iterator[str]:
        """Columns that tell these lines apart."""
        for column in found[0]._cells:
            if len({row._cells[column] for row in found}) > 1:
                yield column


def _value(cell: str) -> Value:
    if cell in ("True", "False"):
        return cell == "True"
    try:
        return float(cell) if cell else None
    except ValueError:
        return cell


def _is_one_of(value: Value, wanted: object) -> bool:
    held = wanted if isinstance(wanted, list | tuple) else [wanted]
    return any(value == (None if each == "" else each) for each in held)


def _text(value: Value) -> str:
    return "an empty cell" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _said(keys: dict[str, object]) -> str:
    return ", ".join(f"{column}={wanted!r}" for column, wanted in keys.items())
