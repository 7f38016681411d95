"""CSV tables of a user's own, read line by line or refused in one."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

from pydantic import ValidationError

from jouleswarm.common.errors import ConfigurationError

_MOST_BYTES = 16 * 2**20


def table_text(path: Path, what: str, expected: str) -> str:
    """A user's file, whole, without a byte-order mark.

    Raises:
        ConfigurationError: it is too large for what is `expected`, or cannot be read; `what` names it.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ConfigurationError(f"{what} {path}: over {_MOST_BYTES} bytes, expected {expected}")
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{what} {path}: cannot be read ({error})") from error


def table_lines(path: Path, what: str, needed: tuple[str, ...]) -> Iterator[tuple[int, dict[str, str]]]:
    """(line number, column -> cell) of each line after the first; empty cells and lines, and those that begin with #,
    are left out.

    Raises:
        ConfigurationError: it cannot be read, or its first line lacks a column of `needed`; `what` names it.
    """
    lines = table_text(path, what, f"a table of {what}").splitlines()
    reader = csv.reader("" if line.lstrip().startswith("#") else line for line in lines)
    head: list[str] = []
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if not any(cells):
                continue
            if head:
                if len(cells) > len(head):
                    raise ConfigurationError(
                        f"{what} {path}, line {reader.line_num}: {len(cells)} cells, expected {len(head)} as of its "
                        "first line"
                    )
                yield reader.line_num, {column: cell for column, cell in zip(head, cells, strict=False) if cell}
            elif missing := [column for column in needed if column not in cells]:
                raise ConfigurationError(
                    f"{what} {path}, line {reader.line_num}: {','.join(cells)!r:.80} lacks the column {missing[0]}, "
                    f"expected {','.join(needed)}, ..."
                )
            elif len(set(cells)) < len(cells):
                raise ConfigurationError(f"{what} {path}, line {reader.line_num}: expected each column once")
            else:
                head = cells
    except csv.Error as error:
        raise ConfigurationError(f"{what} {path}, line {reader.line_num}: {error}") from error
    if not head:
        raise ConfigurationError(f"{what} {path}: is empty, expected the columns {','.join(needed)}, ...")


def first_error(error: ValidationError) -> str:
    """What is wrong with a line, in short."""
    first = error.errors(include_url=False)[0]
    column = "".join(f"{level}: " for level in first["loc"])
    got = f", got {first['input']!r:.60}" if column else ""
    return f"{column}{first['msg'].removeprefix('Value error, ')}{got}"
