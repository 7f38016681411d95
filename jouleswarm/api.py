"""The Python door: runs as the command makes them, and what they left behind as data frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd
from pydantic import BaseModel
from rich.console import Console

from jouleswarm.common.disk.lock import is_held
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.bill import COMPUTING, Bill
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, is_whole, price, price_lists
from jouleswarm.fleet.deploy import RESTARTS, Options, new_run_id, run_deployment
from jouleswarm.metering.metered import Metered
from jouleswarm.report.calculated import calculate
from jouleswarm.report.opened import load
from jouleswarm.report.view import View
from jouleswarm.runs.run import Run as RunData

_NOTHING: Mapping[str, object] = MappingProxyType({})
_SELDOM = (
    *("uplink_datacenter", "downlink_robots", "acting_robots", "evaluating_robots"),
    *("waiting_robots", "waiting_datacenter", "other_datacenter", "other_robots", "untold"),
)
"""Causes that a bill has only where a price list has joules of them."""


def run(
    scenario: str | Path | Mapping[str, Any],
    *,
    seed: int | None = None,
    set: Mapping[str, object] = _NOTHING,
    out: str | Path = "runs",
    run_id: str | None = None,
    broker: str | None = None,
    keys: str | Path | None = None,
    scheduler: str | None = None,
    listen: str | None = None,
    restarts: int = RESTARTS,
    durable: bool = False,
    show: bool = True,
) -> Run:
    """Run a scenario, as `jouleswarm run` does; ends with the run.

    Ctrl-C, or a notebook's stop, ends every process and leaves a readable run directory.

    Args:
        scenario: a name (`toy`), a file, or what a file would hold as a dict; files that it names are looked for
            beside its file, else in the current folder.
        seed: in place of the scenario's.
        set: section.key -> value, changes of the scenario: `{"meta.t0": 42}`.
        out: folder for run directories.
        run_id: name of the run and of its directory; default one that no other run has.
        broker: URL of a broker to use in place of an embedded one.
        keys: folder that all take user, password and certificates from.
        scheduler: of a Dask cluster on whose workers robots and data center run; `out` is on a disk that they share.
        listen: HOST:PORT that the embedded broker listens on.
        restarts: how often each process that was killed is started again.
        durable: whether each round is on the disk, for a power failure.
        show: whether it is shown how the run goes.

    Raises:
        ConfigurationError: the scenario, or a file that it names, cannot be used; nothing has been started.
        JouleSwarmError: the run failed.
        KeyboardInterrupt: it was stopped; the message says what is kept and how to go on.
    """
    changes = [*set.items(), *([("seed", seed)] if seed is not None else [])]
    settings = load_scenario(scenario, changes)
    started = Options(
        broker=broker,
        keys=None if keys is None else Path(keys),
        scheduler=scheduler,
        listen=listen,
        restarts=restarts,
        durable=durable,
        view=View if show else None,
    )
    console = Console(quiet=not show)
    return Run(run_deployment(settings, run_id or new_run_id(settings), Path(out), console, started))


def bill(
    counts: str | Path | Mapping[str, Any] | Iterable[str | Path | Mapping[str, Any]] | None = None,
    *,
    energy: str | Path | None = None,
    set: Mapping[str, object] = _NOTHING,
    prices: str | PriceList | None = None,
    **what: float | Mapping[int, float],
) -> pd.DataFrame:
    """The bill of an experiment of your own, as `Run.bill` has it: `bill(rounds=120, robots=10, model_bytes=2.4e6)`.

    Args:
        counts: a file, files, a folder, or what they would hold: rows as dicts, or a dict as `what`, with the arms'
            own under `arms`.
        energy: a TOML file with [energy], and [[robots]] where they differ; default the paper's Table I.
        set: energy.key -> value, changes of that.
        prices: a list's name, as `energy.prices` has it, or a list itself; default the first of `energy.prices`.
        what: number, or task -> number, by the words of `jouleswarm bill --example`.

    Raises:
        ConfigurationError: something cannot be: one line that says what and where.
    """
    if (counts is None) == (not what):
        raise ConfigurationError("bill: expected counts, or what was done by name, and not both")
    changes = [*set.items(), *([("energy.prices", [prices])] if isinstance(prices, str) else [])]
    found = calculate(what if counts is None else counts, None if energy is None else Path(energy), changes)
    chosen = price_lists(found.tariff)[0] if prices is None or isinstance(prices, str) else prices
    return _bills({arm: _row(chosen, facts, found.tariff.energy) for arm, facts in found.facts.items()})


class Run:
    """A run directory: finished, interrupted, or still going, of which is read what there is by now."""

    def __init__(self, path: str | Path) -> None:
        """Read the directory that `jouleswarm run` printed.

        Raises:
            ConfigurationError: no such directory.
            RunError: it is not a run's, or damaged.
        """
        self.path = Path(path)
        self._data = load(self.path)

    def __repr__(self) -> str:
        return f"<Run {self.path}, {self.status}>"

    @property
    def status(self) -> str:
        """running, complete, interrupted or failed."""
        data = self._read()
        return "running" if data.status != "complete" and is_held(self.path) else data.status

    @property
    def scenario(self) -> Scenario:
        """What was run, resolved.

        Raises:
            ConfigurationError: nothing was, a meter counted.
        """
        if isinstance(self._data, Metered):
            raise ConfigurationError(f"{self.path}: what a meter counted has no scenario")
        return self._data.scenario

    @property
    def rounds(self) -> pd.DataFrame:
        """The rows of rounds.jsonl: one a robot and round; agent 0 is the data center. A meter has none."""
        data = self._read()
        return _frame([] if isinstance(data, Metered) else data.rows, RoundRow)

    @property
    def meter(self) -> pd.DataFrame:
        """The rows of meter.jsonl: cumulative bytes by client, topic and direction, as both sides counted them; or as
        a meter did, with link, phase, rule and labels."""
        data = self._read()
        return pd.DataFrame(data.rows) if isinstance(data, Metered) else _frame(data.meter_rows, MeterRow)

    @property
    def windows(self) -> pd.DataFrame:
        """What passed a meter by windows of time, each row of its window alone and without a topic; a run has none."""
        data = self._read()
        windows = data.windows if isinstance(data, Metered) else ()
        return pd.DataFrame(
            [
                {"begin_s": each.begin_s, "window_s": each.window_s} | asdict(row)
                for each in windows
                for row in each.rows
            ]
        )

    def facts(self, arm: str) -> Facts:
        """What price lists are given of an arm.

        Raises:
            ConfigurationError: no such arm.
        """
        facts = self._read().facts
        if arm not in facts:
            raise ConfigurationError(f"arm {arm!r}: expected one of {', '.join(facts)}")
        return facts[arm]

    def bill(self, prices: str | PriceList = "literal", **energy: object) -> pd.DataFrame:
        """Joules, a row an arm, a column a phase (ml, fl) and cause; they add up to E, eq. (12).

        NaN where something is not known: bytes that nobody metered, an arm for which the list is not defined.

        Args:
            prices: a list's name in the scenario, or as `energy.prices` has it, or a list itself.
            energy: any constant of the scenario's section energy in place of the run's own.

        Raises:
            ConfigurationError: no such list, or one that fails; or a constant that is none.
        """
        data = self._read()
        changes = [(f"energy.{name}", value) for name, value in energy.items()]
        held = {each.name: each for each in data.price_lists} if isinstance(prices, str) else {}
        if isinstance(prices, str) and prices not in held:
            changes.append(("energy.prices", [prices]))
        priced, _ = data.priced(changes)
        if isinstance(prices, str):
            prices = held[prices] if prices in held else price_lists(priced)[0]
        rows = {arm: _row(prices, facts, priced.energy) for arm, facts in data.facts.items()}
        return _bills(rows)

    def _read(self) -> RunData | Metered:
        if self._data.status != "complete":
            self._data = load(self.path)
        return self._data


def _bills(rows: Mapping[str, Mapping[tuple[str, str], float | None]]) -> pd.DataFrame:
    """A row an arm; causes that are seldom only where there are joules of them."""
    columns = [
        column
        for column in next(iter(rows.values()), ())
        if column[1] not in _SELDOM or any(row[column] for row in rows.values())
    ]
    return pd.DataFrame(
        [[row[column] for column in columns] for row in rows.values()],
        index=pd.Index(list(rows), name="arm"),
        columns=pd.MultiIndex.from_tuples(columns, names=["phase", "cause"]),
        dtype=float,
    )


def _row(prices: PriceList, facts: Facts, energy: Energy) -> dict[tuple[str, str], float | None]:
    """(phase, cause) -> joules of one arm."""
    bill, whole = price(prices, facts, energy), is_whole(prices, facts)
    row: dict[tuple[str, str], float | None] = {}
    for phase, cost in (("ml", (bill or Bill()).ml), ("fl", (bill or Bill()).fl)):
        for cause, joules in asdict(cost).items():
            known = bill is not None and (whole or cause in COMPUTING)
            row[phase, cause.removesuffix("_j")] = joules if known else None
    return row


def _frame(rows: list[Any], model: type[BaseModel]) -> pd.DataFrame:
    """Rows as a frame with the model's columns, also of no rows."""
    return pd.DataFrame([row.model_dump(mode="json") for row in rows], columns=list(model.model_fields))
