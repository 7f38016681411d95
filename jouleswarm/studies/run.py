"""A study from end to end: plan, run what is missing, then tables and figures; or these alone."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from jouleswarm.common.errors import ConfigurationError, StudyError, usable
from jouleswarm.common.figure_kinds import KINDS
from jouleswarm.studies.catalogue import kind_of
from jouleswarm.studies.engine import FACTS, collected, run_jobs
from jouleswarm.studies.facts import processors_note, read_facts, write_facts
from jouleswarm.studies.jobs import Request
from jouleswarm.studies.kinds import Kind, write_outputs
from jouleswarm.studies.progress import Progress
from jouleswarm.studies.record import Record, read_record, write_record
from jouleswarm.studies.repriced import check_prices, repriced


@dataclass(frozen=True)
class Where:
    """Where a study works."""

    work: Path
    results: Path
    workers: int
    scheduler: str | None
    keep: bool
    kinds: Sequence[str] = KINDS
    """Of files that figures are."""


def run_study(kind: Kind, request: Request, profile: str, where: Where, console: Console) -> list[Path]:
    """Run a study, or the rest of it; returns the paths of tables and figures.

    Raises:
        ConfigurationError: a job's scenario cannot be used, or priced; nothing has been run.
        StudyError: jobs failed. The others are collected, and in tables and figures.
    """
    from jouleswarm.studies.cluster import connected
    from jouleswarm.studies.deployment import run_job

    plan = kind.plan(request)
    scenario = request.scenario(plan.settings)
    check_prices(scenario)
    for job in plan.jobs:
        job.load()  # before hours are spent on others
    with usable("--results", where.results):
        where.results.mkdir(parents=True, exist_ok=True)
    record = Record(
        study=kind.name,
        profile=profile,
        scenario=scenario,
        seeds=request.seeds,
        t0=request.t0,
        groups=plan.groups,
        values=plan.values,
        training=plan.training,
        more_seeds=request.more_seeds,
        tuned=request.tuned,
    )
    write_record(where.results, record)
    try:
        failed = run_jobs(
            plan.jobs,
            functools.partial(run_job, work=where.work.resolve(), keep=where.keep),
            where.results,
            functools.partial(connected, where.scheduler, min(where.workers, len(plan.jobs))),
            Progress(console, f"study {kind.name}"),
        )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"stopped: {len(collected(where.results, plan.jobs))} facts are kept in {where.results}; "
            "the same command goes on with the jobs that are left"
        ) from None
    facts = read_facts(where.results / FACTS)
    written = make_tables(where.results, where.kinds) if facts else []
    if note := processors_note(facts):
        console.print(note, highlight=False)
    if failed:
        told = "; ".join(f"{name} ({type(error).__name__}: {error})" for name, error in failed.items())
        raise StudyError(f"{len(failed)} of {len(plan.jobs)} jobs failed, run again to try them again: {told}")
    return written


def reprice(results: Path, changes: Sequence[str], into: Path | None, kinds: Sequence[str] = KINDS) -> list[Path]:
    """Make a results folder with the same facts at other prices; nothing is run, and `results` stays as it is.

    Args:
        results: a results folder of a study.
        changes: `energy.key=value`, as in a scenario.
        into: the other folder; it is whole, so that its tables can be made again as well.

    Raises:
        ConfigurationError: a change that is none of prices, or no folder for what comes of it.
        StudyError: `results` holds no study.
    """
    if into is None or into.resolve() == results.resolve():
        raise ConfigurationError(f"--set: expected --out FOLDER, so that {results} keeps the prices it was made with")
    record, facts = repriced(results, changes)
    with usable("--out", into):
        into.mkdir(parents=True, exist_ok=True)
    write_record(into, record)
    write_facts(into / FACTS, facts)
    return make_tables(into, kinds)


def make_tables(results: Path, kinds: Sequence[str] = KINDS) -> list[Path]:
    """Make a study's tables and figures again from its facts; nothing is run.

    Raises:
        StudyError: `results` holds no study, or one without facts.
    """
    record = read_record(results)
    facts = read_facts(results / FACTS)
    if not facts:
        raise StudyError(f"{results / FACTS} holds no facts, expected some; run the study")
    return write_outputs(results, kind_of(record.study).outputs(facts, record), kinds)
