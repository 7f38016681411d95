"""A study's facts at other prices. Nothing is run and nothing is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.prices import price_lists, with_beta
from jouleswarm.energy.repricing import reprice
from jouleswarm.report.table import Table
from jouleswarm.studies.catalogue import kind_of
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.facts import Fact, read_facts
from jouleswarm.studies.kinds import as_told
from jouleswarm.studies.prices import facts_of
from jouleswarm.studies.record import RECORD, Record, read_record
from jouleswarm.studies.uncertain import uncertain_csv, uncertain_rows
from jouleswarm.studies.why import against_plain, why_csv


def repriced(results: Path, changes: Sequence[str]) -> tuple[Record, list[Fact]]:
    """What a results folder holds, with other prices in its record.

    Args:
        results: a results folder of a study.
        changes: `energy.key=value`, as in a scenario.

    Raises:
        ConfigurationError: a change that is none of prices, or a price that its facts do not tell.
        StudyError: `results` holds no study.
    """
    record = read_record(results)
    scenario, _ = reprice(record.scenario, changes, str(results / RECORD))
    check_prices(scenario)
    facts = read_facts(results / FACTS)
    if scenario.energy.beta == "measured":
        for fact in facts:
            with_beta(scenario.energy, facts_of([fact]))
    return record.model_copy(update={"scenario": scenario}), facts


def table_at(results: Path, changes: Sequence[str], name: str) -> Table:
    """One of a study's tables at other prices, by the name of its CSV file.

    Raises:
        ConfigurationError: see `repriced`; or the study has no such table.
        StudyError: `results` holds no study.
    """
    record, facts = repriced(results, changes)
    energy, held = record.scenario.energy, as_told(facts, record.scenario)
    # Those that every study has are made alone: its own take seconds where seeds are drawn again.
    common: dict[str, Callable[[], Table]] = {
        "why": lambda: why_csv(against_plain(held, record.scenario), energy),
        "uncertain": lambda: uncertain_csv(uncertain_rows(held, energy, record.lists)),
    }
    if name in common:
        return common[name]()
    own = kind_of(record.study).tables(held, record).csv
    if name not in own:
        raise ConfigurationError(f"{results}: no table {name!r} at other prices, expected {', '.join([*own, *common])}")
    return own[name]


def check_prices(scenario: Scenario) -> None:
    """Whether facts, which are sums over robots and links, can be priced.

    Raises:
        ConfigurationError: they cannot.
    """
    price_lists(scenario)
    if not scenario.energy.is_alike:
        raise ConfigurationError(
            "energy: got loss, idle power, links or constants of single robots; expected none, as a study keeps sums "
            "alone; `jouleswarm report` prices its runs"
        )
