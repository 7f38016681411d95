"""A run directory as data, read back whole or as far as an interrupted run got."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from jouleswarm.common.doors import DOORS
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.joules import JoulesRow
from jouleswarm.common.meter.meter import MeterRow, read_joules, read_rows, read_work
from jouleswarm.common.meter.work import WorkRow
from jouleswarm.common.scenario.kept import as_kept
from jouleswarm.common.scenario.reading import Override, scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, price_lists
from jouleswarm.energy.repricing import reprice
from jouleswarm.runs.arm_facts import arm_facts, in_packets
from jouleswarm.runs.conservation import Balance, conservation
from jouleswarm.runs.directory import JOULES, MANIFEST, METER, PROGRESS, ROUNDS, STATE, SUMMARY, WORK
from jouleswarm.runs.facts import TaskResult, meta_rounds, task_results
from jouleswarm.runs.files import other_version, read_lines, read_summary, run_manifest
from jouleswarm.runs.lost_work import lost_work

_NOT_OF_PRICES = ("results", "t0", "lost", "misfits", "facts", "kept_facts", "packet_facts")


class Progress(BaseModel):
    """A point of the byte curves: payload bytes received so far, all clients together."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    time_s: float
    bytes: dict[Link, int]


@dataclass(frozen=True)
class Run:
    """What a run directory holds. `cut` lists files whose last line was torn off by a kill."""

    path: Path
    manifest: dict[str, Any]
    scenario: Scenario
    rows: list[RoundRow]
    meter_rows: list[MeterRow]
    progress: list[Progress]
    summary: dict[str, Any] | None
    cut: list[str]
    work_rows: Sequence[WorkRow] = ()
    joules_rows: Sequence[JoulesRow] = ()

    @property
    def name(self) -> str:
        """The run's name on the bus."""
        return str(self.manifest["run"])

    @property
    def status(self) -> str:
        """complete, interrupted or failed; a run without a summary was interrupted."""
        return "interrupted" if self.summary is None else str(self.summary["status"])

    @cached_property
    def results(self) -> dict[str, list[TaskResult]]:
        """Task results by arm."""
        return {arm: task_results(self.scenario, self.rows, arm) for arm in self.scenario.arm_names}

    @cached_property
    def t0(self) -> dict[str, int]:
        """Rounds of meta-learning done behind each arm's model; 0 without."""
        return {arm: meta_rounds(self.rows, arm) for arm in self.scenario.arm_names}

    @cached_property
    def lost(self) -> list[WorkRow]:
        """What was done and is in no row; see `runs.lost_work`."""
        return lost_work(self.scenario, self.rows, self.work_rows)

    @cached_property
    def price_lists(self) -> tuple[PriceList, ...]:
        """What the scenario's `energy.prices` names."""
        return price_lists(self.scenario)

    @cached_property
    def facts(self) -> dict[str, Facts]:
        """What each arm has done, for price lists."""
        return self._facts(self.lost)

    @cached_property
    def kept_facts(self) -> dict[str, Facts]:
        """The same without what was done in vain."""
        return self._facts(()) if self.lost else self.facts

    @cached_property
    def packet_facts(self) -> dict[str, Facts]:
        """`facts` with counts of whole packets' bytes."""
        of_run = self.scenario, self.rows, self.meter_rows, self.lost
        return {arm: in_packets(facts, *of_run) for arm, facts in self.facts.items()}

    def _facts(self, lost: Sequence[WorkRow]) -> dict[str, Facts]:
        of_run = self.scenario, self.rows, self.meter_rows
        return {arm: arm_facts(*of_run, arm, lost=lost) for arm in self.scenario.arm_names}

    def at(self, scenario: Scenario) -> Run:
        """The same run at other prices; facts do not depend on them."""
        other = replace(self, scenario=scenario)
        vars(other).update({name: held for name, held in vars(self).items() if name in _NOT_OF_PRICES})
        return other

    def priced(self, changes: Iterable[Override] = ()) -> tuple[Scenario, str]:
        """Its scenario at prices with changes `energy.key=value`, and what these put into file names.

        Raises:
            ConfigurationError: no such price, or it can't be that.
        """
        return reprice(self.scenario, changes, str(self.path))

    @cached_property
    def misfits(self) -> tuple[Balance, ...]:
        """Where the final counters of broker and clients contradict each other; those of a run cut short are not
        final."""
        found = conservation(self.meter_rows) if self.status == "complete" else None
        return found.broken if found is not None else ()

    def rounds(self, arm: str) -> dict[int, float]:
        """t_i by task."""
        return {result.task: result.rounds for result in self.results[arm]}

    def mean_rounds(self, arm: str) -> dict[int, float]:
        """The mean over each task's robots of the rounds they took: t_i unless they stop by themselves."""
        return {
            result.task: result.robot_rounds / len(self.scenario.cluster(result.task)) for result in self.results[arm]
        }


def load_run(path: str | Path) -> Run:
    """Read a run directory, also of a run that was cut short.

    Raises:
        ConfigurationError: `path` is not a run directory.
        RunError: a file that must be there is missing, or one is damaged (a torn last line is not damage), or written
            by another version in a way that this one cannot read.
    """
    path = Path(path)
    if not path.is_dir():
        raise ConfigurationError(f"run {path}: no such directory; name the one that `jouleswarm run` printed")
    manifest = run_manifest(path)
    try:
        return _load(path, manifest)
    except RunError as error:
        if (other := other_version(manifest)) is None:
            raise
        raise RunError(f"{path}: {other}, which cannot read it; report it with the version that wrote it") from error


def _load(path: Path, manifest: dict[str, Any]) -> Run:
    summary = read_summary(path / SUMMARY)
    cut: list[str] = []
    done = summary is not None
    return Run(
        path=path,
        manifest=manifest,
        scenario=_scenario(manifest, path / MANIFEST),
        rows=_once(read_lines(path / ROUNDS, RoundRow, needed=done, cut=cut), path / ROUNDS),
        meter_rows=read_lines(path / METER, MeterRow, needed=False, cut=None) or _kept_rows(path, str(manifest["run"])),
        work_rows=read_lines(path / WORK, WorkRow, needed=False, cut=None) or _kept_work(path),
        joules_rows=read_lines(path / JOULES, JoulesRow, needed=False, cut=None) or _kept_joules(path),
        progress=read_lines(path / PROGRESS, Progress, needed=False, cut=cut),
        summary=summary,
        cut=cut,
    )


def _kept_rows(path: Path, run: str) -> list[MeterRow]:
    """What the processes of a run that was killed had counted by then."""
    state, prefix = path / STATE, f"{topics.ROOT}/{run}/"
    rows = read_rows("broker", state / "broker")
    for folder in sorted(state.glob("*")):
        if folder.name != "broker":
            rows += read_rows("client", folder)
    return [row for row in rows if row.topic.startswith(prefix)]


def _once(rows: list[RoundRow], file: Path) -> list[RoundRow]:
    """Rows none of which stands twice: a bill would count it twice."""
    first: dict[object, int] = {}
    for number, row in enumerate(rows, start=1):
        before = first.setdefault(row.sort_key(), number)
        if before != number:
            who = f"robot {row.agent}" if row.agent else "the data center"
            raise RunError(
                f"{file}, line {number}: round {row.round} of {who} in {row.arm} stands in line {before} already; "
                "two processes wrote it, or somebody altered it"
            )
    return rows


def _kept_work(path: Path) -> list[WorkRow]:
    """What the processes of a run that was killed had done by then."""
    return [row for folder in sorted((path / STATE).glob("*")) for row in read_work(folder.name, folder)]


def _kept_joules(path: Path) -> list[JoulesRow]:
    """What they had measured."""
    return [row for folder in sorted((path / STATE).glob("*")) for row in read_joules(folder.name, folder)]


def _scenario(manifest: dict[str, Any], file: Path) -> Scenario:
    try:
        kept, interface = as_kept(manifest["scenario"]), manifest.get("interface")
        scenario = scenario_from(kept, str(file), file.parent / DOORS, interface)
    except ConfigurationError as error:
        raise RunError(f"{file}: damaged: {error}") from error
    if scenario.digests != manifest.get("doors", {}):
        raise RunError(f"{file.parent / DOORS}: not as it was written; run the scenario again")
    return scenario
