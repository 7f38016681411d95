"""A meter's run directory, read back."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from jouleswarm.common.doors import DOORS
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.counts_file import COUNTS
from jouleswarm.common.meter.tally import Row
from jouleswarm.common.scenario.documents import parse_json
from jouleswarm.common.scenario.reading import Override
from jouleswarm.common.scenario.tariff import Tariff, tariff_of
from jouleswarm.common.wire.rules import Rule, parse_rules
from jouleswarm.energy.calculator import facts_of
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, price_lists
from jouleswarm.energy.repricing import changed_fields, words_of
from jouleswarm.energy.rows import Row as BillRow
from jouleswarm.energy.rows import read_rows
from jouleswarm.metering.counted import read_counted
from jouleswarm.metering.directory import FACTS, KIND, MANIFEST, METER, SCHEMA, SUMMARY, WINDOWS
from jouleswarm.metering.windows import Window
from jouleswarm.metering.written import Told, bill_rows, numbers_of, told_rows


@dataclass(frozen=True)
class Metered:
    """What a meter has left, or writes still."""

    path: Path
    manifest: dict[str, Any]
    rows: list[Row]
    rules: list[Rule]
    windows: Sequence[Window] = ()
    told: Sequence[Told] = ()
    is_complete: bool = False

    @property
    def name(self) -> str:
        return str(self.manifest["run"])

    @property
    def status(self) -> str:
        """complete, or interrupted: still running, or killed."""
        return "complete" if self.is_complete else "interrupted"

    @cached_property
    def numbers(self) -> dict[str, int]:
        """The number that each client goes by in prices and bills, as a robot."""
        return numbers_of(self.rows, self.told)

    @cached_property
    def bill_rows(self) -> list[BillRow]:
        """What is priced; nothing where nothing passed that is."""
        found = [*bill_rows(self.rows, self.rules, self.numbers), *told_rows(self.told, self.numbers)]
        return read_rows(found) if found else []

    @cached_property
    def facts(self) -> dict[str, Facts]:
        """What each arm has done."""
        return facts_of(self.bill_rows) if self.bill_rows else {}

    @cached_property
    def price_lists(self) -> tuple[PriceList, ...]:
        """What its prices name."""
        return price_lists(self.priced()[0])

    def priced(self, changes: Iterable[Override] = ()) -> tuple[Tariff, str]:
        """Its prices with changes `energy.key=value` and (robots, a list), and what these put into file names.

        Raises:
            ConfigurationError: no such price, or it can't be that.
        """
        held = list(changes)
        fields = changed_fields(each for each in held if each[:1] != ("robots",))
        folder = Path.cwd() if {"prices", "links"} & {*fields} else self.path / DOORS
        own = [(f"energy.{key}", value) for key, value in self.manifest["energy"].items()]
        tariff = tariff_of(
            [*own, ("robots", self.manifest["robots"]), *held], folder, set(self.numbers.values()), str(self.path)
        )
        return tariff, words_of(tariff.energy, fields)


def is_metered(path: Path) -> bool:
    """Whether it is the run directory of a meter; whatever it is, nothing is said of it."""
    try:
        held = parse_json((path / MANIFEST).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(held, dict) and held.get("kind") == KIND


def load_metered(path: Path) -> Metered:
    """Read it, also of a meter that was killed or counts still.

    Raises:
        RunError: it is none, or not as it was written.
    """
    file = path / MANIFEST
    try:
        manifest = parse_json(file.read_bytes())
        if manifest["schema"] != SCHEMA or manifest["kind"] != KIND:
            raise ValueError(f"schema {manifest['schema']} of version {manifest['versions']['jouleswarm']}")
        rules = parse_rules(manifest["rules"], str(file))
        file = path / METER
        rows = [Row(**each) for each in _lines(file)]
        file = path / WINDOWS
        windows = [
            Window(each["begin_s"], each["window_s"], [Row(**row) for row in each["rows"]]) for each in _lines(file)
        ]
        file = path / FACTS
        told = _lines(file)
        if (file := path / COUNTS).exists():
            rows, told = read_counted(file, rules)
    except (OSError, ValueError, TypeError, KeyError, ConfigurationError) as error:
        raise RunError(f"{file}: cannot be read ({error}), expected what `jouleswarm meter` writes") from error
    return Metered(path, manifest, rows, rules, windows, told, (path / SUMMARY).exists())


def _lines(file: Path) -> list[Any]:
    """Of a file that is not there yet none."""
    return [parse_json(line) for line in file.read_bytes().splitlines()] if file.exists() else []
