"""Joules that meters read from outside, beside what the same rounds are priced at; never in a bill."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.wire.names import client_of
from jouleswarm.energy.facts import Facts, Phase
from jouleswarm.energy.items import items
from jouleswarm.energy.prices import with_beta
from jouleswarm.report.format import joules_text, number_text
from jouleswarm.report.table import Cell, Table
from jouleswarm.runs.directory import TIMES
from jouleswarm.runs.files import read_lines
from jouleswarm.runs.metering import Power, Read, RowTime, Span, power_of, read, spans_of
from jouleswarm.runs.power_log import Log, read_logs
from jouleswarm.runs.run import Run

_WHOLE = 0.99
"""Share of the seconds that must be known, so that there is a ratio."""
_PHASES: dict[Phase, str] = {"ml": "meta", "fl": "clusters"}


class Meters(NamedTuple):
    """What a user says of power logs."""

    files: Sequence[Path] = ()
    names: Sequence[str] = ()
    """`shelly1=agent-3`: whose a name of the logs is, where it is not the process's own."""
    shift_s: float = 0.0
    """Added to the logs' times."""


def outside_table(run: Run, energy: Energy, meters: Meters) -> Table:
    """A row an arm, phase and metered process, by the equations' prices; one for the time between its rounds.

    Raises:
        ConfigurationError: the run has no times, a log is none or of another time, or a name is of no process.
        RunError: the run's times are damaged.
    """
    times = read_lines(run.path / TIMES, RowTime, needed=False, cut=[])
    if not times:
        raise ConfigurationError(f"--meter: {run.path} has no times ({TIMES}): run its scenario again, with the meter")
    if not math.isfinite(meters.shift_s):
        raise ConfigurationError(f"--meter-shift {meters.shift_s}: expected seconds")
    spans, logs = spans_of(run.rows, times), read_logs(meters.files)
    whose = _owners(run, logs, meters.names)
    powers = {name: power_of(log, meters.shift_s) for name, log in logs.items()}
    of_agent: dict[int, list[str]] = {}
    for name in logs:
        of_agent.setdefault(whose[name], []).append(name)
    metered = {agent: [powers[name] for name in names] for agent, names in of_agent.items()}
    rows: list[list[Cell]] = []
    known_s = 0.0
    for arm, facts in run.kept_facts.items():
        priced = _priced(facts, energy)
        for found in read(run.rows, spans, arm, metered):
            rows.append(_cells(found, priced.get((found.phase, found.agent), (0.0, 0.0))))
            known_s += found.known_s
    if not known_s:
        raise ConfigurationError(_elsewhere(list(spans.values()), logs, meters.shift_s))
    left_out, notes = [], []
    for agent, names in of_agent.items():
        mine = sorted(span for key, span in spans.items() if key[3] == agent)
        if mine:
            rows.append(_between(agent, mine, metered[agent]))
            left_out += [line for name in names for line in _left_out(name, logs[name], mine, meters.shift_s)]
            notes += [line for name in names for line in _gaps(name, powers[name], mine)]
    if left_out:
        notes.append(f"Left out, before a process's first round or after its last: {', '.join(left_out)}.")
    if 0 in of_agent and energy.pue != 1:
        notes.append(
            f"What the data center is priced at has its PUE of {energy.pue:g} in it; a meter at its plug has not."
        )
    if not all(facts.metered for facts in run.facts.values()):
        notes.append("Bytes were not counted: priced is computing alone.")
    headings = ["", "seconds", "measured", "priced", "computing", "ratio"]
    return Table("Joules measured by a meter, against priced (all, and computing alone)", headings, rows, notes)


def _priced(facts: Facts, energy: Energy) -> dict[tuple[Phase, int], tuple[float, float]]:
    """Phase and payer -> joules, and those of them for computing."""
    found: dict[tuple[Phase, int], tuple[float, float]] = {}
    for item in items(facts, with_beta(energy, facts)):
        whole, computing = found.get((item.phase, item.payer), (0.0, 0.0))
        computing += item.joules * item.field.startswith("computing")
        found[item.phase, item.payer] = whole + item.joules, computing
    return found


def _cells(found: Read, priced: tuple[float, float]) -> list[Cell]:
    seconds = number_text(found.seconds)
    is_whole = found.known_s >= _WHOLE * found.seconds > 0
    ratio = f"{found.joules / priced[0]:.3f}" if is_whole and priced[0] else None
    told = seconds if is_whole else f"{number_text(found.known_s)} of {seconds}"
    measured_j = found.joules if found.known_s else None
    name = f"{found.arm} {_PHASES[found.phase]}, {client_of(found.agent)}"
    return [name, told, *map(joules_text, (measured_j, *priced)), ratio]


def _between(agent: int, spans: list[Span], powers: Sequence[Power]) -> list[Cell]:
    begin_s, end_s = spans[0][0], max(end for _, end in spans)
    joules = round(sum(power.within([(begin_s, end_s)])[0] - power.within(spans)[0] for power in powers), 6)
    seconds = end_s - begin_s - sum(end - begin for begin, end in spans)
    return [f"between rounds, {client_of(agent)}", number_text(seconds), joules_text(joules or None), None, None, None]


def _left_out(name: str, log: Log, spans: list[Span], shift_s: float) -> Iterator[str]:
    begin_s, end_s = spans[0][0], max(end for _, end in spans)
    count = sum(not begin_s <= each + shift_s <= end_s for each in log.time_s)
    if count:
        yield f"{count} of {len(log.time_s)} samples of {name}"


def _gaps(name: str, power: Power, spans: list[Span]) -> Iterator[str]:
    begin_s, end_s = spans[0][0], max(end for _, end in spans)
    holes = [(begin, end) for begin, end in power.holes if begin < end_s and end > begin_s]
    if holes:
        begin, end = max(holes, key=lambda hole: hole[1] - hole[0])
        whole = sum(each[1] - each[0] for each in holes)
        yield (
            f"{name}: gaps between samples: {len(holes)}, {whole:.1f} s in all, the longest {end - begin:.1f} s from "
            f"{_clock(begin)}; joules of gaps are not known, nor counted."
        )


def _owners(run: Run, logs: Mapping[str, Log], told: Sequence[str]) -> dict[str, int]:
    """Name in the logs -> agent."""
    agents = (0, *run.scenario.agents) if run.scenario.needs_datacenter else run.scenario.agents
    processes = {client_of(agent): agent for agent in agents}
    expected = f"expected one of {', '.join(processes)}"
    owners = {name: processes[name] for name in logs if name in processes}
    for each in told:
        name, _, process = each.rpartition("=")
        if name not in logs:
            raise ConfigurationError(
                f"--meter-name {each}: no such name, the logs of --meter have {', '.join(logs) or 'none'}"
            )
        if process not in processes:
            raise ConfigurationError(f"--meter-name {each}: {process!r} is no process of this run, {expected}")
        owners[name] = processes[process]
    if unknown := [name for name in logs if name not in owners]:
        raise ConfigurationError(
            f"--meter: {unknown[0]!r} is no process of this run, {expected}; say whose it is: "
            f"--meter-name '{unknown[0]}={next(iter(processes))}'"
        )
    return owners


def _elsewhere(spans: Sequence[Span], logs: Mapping[str, Log], shift_s: float) -> str:
    if not logs:
        return "--meter: no samples"
    begin_s = min(log.time_s[0] for log in logs.values()) + shift_s
    end_s = max(log.time_s[-1] for log in logs.values()) + shift_s
    run = f"{_clock(min(begin for begin, _ in spans))} to {_clock(max(end for _, end in spans))}" if spans else "-"
    return (
        f"--meter: samples are from {_clock(begin_s)} to {_clock(end_s)}, rounds of the run from {run}: nothing of one "
        "is in the other; set the clock right with --meter-shift"
    )


def _clock(time_s: float) -> str:
    return datetime.datetime.fromtimestamp(time_s, datetime.UTC).isoformat(timespec="seconds")
