"""What anybody fills in of an experiment of their own: rows of what, how much, and where it belongs."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.bounds import Id
from jouleswarm.common.scenario.documents import parse_json, parse_toml
from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.scenario.sections import Section
from jouleswarm.common.scenario.tables import first_error, table_lines
from jouleswarm.energy.named import with_numbers

SETTINGS = {
    "rounds": "rounds until the task was learned, t_i; 0 is allowed",
    "robots": "robots (clients) that learn the task together; default 1",
    "links": "directed links between neighbours, 2 for a pair; left out: by a server, each model up and one down",
    "model_bytes": "size of the model, b(W): what one message of weights has",
    "batches": "batch gradients of a robot in a round, B_i",
    "seen": "1 of a task that the stage before was learned from, for break-even; left out everywhere: all alike",
    "t0": "rounds of the stage in the data center before, of MAML say; left out or 0: none",
    "training_robots": "robots that send experience up in each of them, all tasks together",
    "experience_bytes": "what one of them sends in a round, b(E)",
    "support_batches": "batch gradients of the data center for each of them in a round, B^(a)",
    "query_batches": "the same on B^(b), which cost beta times as much",
}
"""What counts are worked out from, eqs. (9) and (11)."""
COUNTS = {
    "gradients": "batch gradients; robot: whose (in phase ml the data center's where none is named)",
    "query_gradients": "gradients of the data center that cost beta times as much",
    "motions": "motions of a robot to learn from",
    "evaluation_motions": "motions of its greedy episodes",
    "uplink_bytes": "delivered to the data center; robot: the sender",
    "downlink_bytes": "delivered by the data center; robot: the receiver",
    "sidelink_bytes": "delivered to neighbours; robot: the sender, to: the receiver",
    "sidelink_sent_bytes": "sent once for all neighbours, for sidelinks via a base station; default as delivered",
    "uplink_messages": "beside the bytes, where a link costs joules a message",
    "downlink_messages": "the same",
    "sidelink_messages": "the same",
}
"""What was counted; it comes before what is worked out. Counts of several rows add up."""
MEASURED = ("seconds", "cpu_s", "joules")
"""What was measured beside it, by `activity`, joules with `how`: told, and never in a bill."""
BESIDE = ("uplink_array_bytes", "downlink_array_bytes")
"""Of the bytes those of arrays alone: told, and never in a bill."""
_WHOLE = ("robots", "links", "training_robots")
_MAY_BE_NOTHING = ("rounds", "links", "t0", *MEASURED)
_OF_STAGE = ("training_robots", "experience_bytes", "support_batches", "query_batches")
NEEDED = ("what", "value")
_EXAMPLE = """arm,task,what,value
,,robots,10
,,model_bytes,2400000
,,batches,50
FedAvg,,rounds,120
from a meta-model,,t0,30
from a meta-model,,training_robots,4
from a meta-model,,experience_bytes,3000000
from a meta-model,,support_batches,10
from a meta-model,,query_batches,10
from a meta-model,,rounds,40
"""


def _number(cell: object) -> object:
    return DATA_CENTER if cell == "datacenter" else cell


_Found = tuple[str, Any]
"""(where it stands, the cells of a row)."""
_Node = Annotated[int, BeforeValidator(_number), Field(ge=0, le=1_000_000)]


class Row(Section):
    """One line."""

    arm: str = Field("", max_length=100)
    """"": all of them."""
    phase: Literal["ml", "fl"] = "fl"
    task: Id | None = None
    """None: all of them."""
    robot: _Node | None = None
    """None: nobody in particular; 0: the data center."""
    to: _Node | None = None
    what: str
    value: float = Field(ge=0, le=1e24)
    end: Literal["", "sent", "received"] = ""
    """Of bytes and messages: which end of the link counted; what both ends tell counts once."""
    activity: str = Field("", max_length=100)
    """What the process did meanwhile; for who reads it, as is the round."""
    round: int | None = None
    how: str = Field("", max_length=100)
    where: str = ""
    """In errors."""

    @field_validator("what")
    @classmethod
    def _is_known(cls, what: str) -> str:
        if what not in (*SETTINGS, *COUNTS, *MEASURED, *BESIDE):
            close = difflib.get_close_matches(what, [*SETTINGS, *COUNTS], 1)
            hint = f"did you mean {close[0]}?" if close else f"expected one of {', '.join((*SETTINGS, *COUNTS))}"
            raise ValueError(hint)
        return what

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.value == 0 and self.what not in _MAY_BE_NOTHING:
            raise ValueError(f"{self.what} is 0, expected more, or no such row")
        if self.what in _WHOLE and self.value != int(self.value):
            raise ValueError(f"{self.what} is {self.value:g}, expected a whole number")
        if self.what in SETTINGS and (self.robot is not None or self.to is not None or self.phase == "ml"):
            raise ValueError(
                f"{self.what} with a robot or phase ml, expected arm and task alone (rounds of a stage before are t0)"
            )
        if self.what in (*_OF_STAGE, "t0") and self.task is not None:
            raise ValueError(f"{self.what} with a task, expected none: it is for all tasks together")
        if self.to is not None and not self.what.startswith("sidelink"):
            raise ValueError(f"{self.what} with a receiver, expected one with sidelinks only")
        if self.robot == DATA_CENTER and self.what not in ("gradients", "query_gradients", *MEASURED):
            raise ValueError(f"{self.what} of the data center, expected a robot's number, or nothing")
        return self


def example() -> str:
    """A file to start from: what may stand in `what`, and ten robots that learn with a stage before and without."""
    told = [f"#   {what}: {meaning}" for what, meaning in (SETTINGS | COUNTS).items()]
    head = "# Price it: jouleswarm bill FILE. An empty arm or task is for all; columns phase (ml, fl), robot and to may"
    return "\n".join([head, "# be added, for what was counted of one of them. what is one of:", *told, _EXAMPLE])


def read_rows(given: Any) -> list[Row]:
    """Rows out of CSV, TOML or JSON files, or the same as plain data; of a folder all its CSV files. Several files are
    one experiment.

    A table is `{what: value, ...}`, where a value may be `{task: value}`, and `arms` names more such tables, which are
    those arms' own; a list is one of rows. CSV has columns what and value, and may have the others of `Row`. Robots may
    have names (see `named.with_numbers`).

    Args:
        given: a path or paths, a mapping, or rows as mappings.

    Raises:
        ConfigurationError: one line that says what is wrong and where.
    """
    sources: list[Any] = [given] if isinstance(given, str | Path | Mapping) else list(given)
    where, found = "counts", list[_Found]()
    if sources and all(isinstance(each, str | Path) for each in sources):
        where = ", ".join(map(str, sources))
        found = [one for each in sources for path in _files(Path(each)) for one in _of_file(path)]
    else:
        found = list(_of_document(given if isinstance(given, Mapping) else sources, where))
    for place, cells in found:
        if not isinstance(cells, Mapping):
            raise ConfigurationError(f"{place}: got {type(cells).__name__}, expected a row of what and value")
    numbered = with_numbers([cells for _, cells in found])
    return _once([_row(cells, place) for (place, _), cells in zip(found, numbered, strict=True)], where)


def _files(path: Path) -> list[Path]:
    return sorted(path.glob("*.csv")) if path.is_dir() else [path]


def _of_file(path: Path) -> Iterator[_Found]:
    if path.suffix in (".toml", ".json"):
        yield from _of_document(_document(path), str(path))
    else:
        yield from ((f"{path}, line {number}", cells) for number, cells in table_lines(path, "counts", NEEDED))


def _of_document(held: Any, where: str) -> Iterator[_Found]:
    if isinstance(held, Mapping):
        yield from ((f"{where}, {'.'.join(place)}", cells) for place, cells in _flat(held, where))
    else:
        yield from ((f"{where}, row {number}", cells) for number, cells in enumerate(held, start=1))


def _document(path: Path) -> Any:
    try:
        text = path.read_text(encoding="utf-8")
        found = parse_toml(text) if path.suffix == ".toml" else parse_json(text)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"counts {path}: cannot be read ({error})") from error
    if not isinstance(found, dict | list):
        raise ConfigurationError(f"counts {path}: got {type(found).__name__}, expected a table or a list of rows")
    return found


def _flat(table: Mapping[str, Any], where: str, arm: str = "") -> Iterator[tuple[list[str], dict[str, Any]]]:
    """(where it stands, its cells) of each number."""
    arms = table.get("arms", {}) if not arm else {}
    if not isinstance(arms, Mapping) or not all(isinstance(each, Mapping) for each in arms.values()):
        raise ConfigurationError(f"{where}: arms: expected a table of each arm's own, by its name")
    for what, value in table.items():
        if what == "arms" and not arm:
            continue
        of = {"arm": arm, "what": what}
        for task, one in value.items() if isinstance(value, Mapping) else [(None, value)]:
            yield [each for each in (arm, what, str(task or "")) if each], of | {"task": task, "value": one}
    for name, own in arms.items():
        yield from _flat(own, where, str(name) or "?")


def _row(cells: object, where: str) -> Row:
    try:
        row = Row.model_validate(cells)
    except ValidationError as error:
        raise ConfigurationError(f"{where}: {first_error(error)}") from None
    return row.model_copy(update={"where": where})


def _once(rows: list[Row], where: str) -> list[Row]:
    """Rows, some at least, each setting once, and of what both ends of a link have counted the receiver's."""
    if not rows:
        raise ConfigurationError(f"{where}: no rows, expected some; `jouleswarm bill --example` prints a file")
    seen: dict[tuple[str, int | None, str], Row] = {}
    for row in rows:
        first = seen.setdefault((row.arm, row.task, row.what), row)
        if first is not row and row.what in SETTINGS:
            raise ConfigurationError(f"{row.where}: {row.what} stands in {first.where} already, expected it once")
    received = {_flow(row) for row in rows if row.end == "received"}
    return [row for row in rows if row.end != "sent" or _flow(row) not in received]


def _flow(row: Row) -> tuple[object, ...]:
    return row.arm, row.phase, row.what, row.robot, row.to
