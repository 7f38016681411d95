"""A study from end to end: plan, run what is missing, then tables and figures; or these alone."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from common.errors import StudyError
from studies.catalogue import kind_of
from studies.engine import FACTS, run_jobs
from studies.facts import read_facts
from studies.jobs import Request
from studies.kinds import Kind, write_outputs
from studies.progress import Progress
from studies.record import Record, read_record, write_record


@dataclass(frozen=True)
class Where:
    """Where a study works."""

    work: Path
    results: Path
    workers: int
    scheduler: str | None
    keep: bool


def run_study(kind: Kind, request: Request, profile: str, where: Where, console: Console) -> list[Path]:
    """Run a study, or the rest of it; returns the paths of tables and figures.

    Raises:
        ConfigurationError: a job's scenario cannot be used; nothing has been run.
        StudyError: jobs failed. The others are collected, and in tables and figures.
    """
    from studies.cluster import connected
    from studies.deployment import run_job

    plan = kind.plan(request)
    for job in plan.jobs:
        job.load()  # before hours are spent on others
    where.results.mkdir(parents=True, exist_ok=True)
    record = Record(
        study=kind.name,
        profile=profile,
        scenario=request.scenario(plan.settings),
        seeds=request.seeds,
        t0=request.t0,
        groups=plan.groups,
        values=plan.values,
    )
    write_record(where.results, record)
    failed = run_jobs(
        plan.jobs,
        functools.partial(run_job, work=where.work.resolve(), keep=where.keep),
        where.results,
        functools.partial(connected, where.scheduler, min(where.workers, len(plan.jobs))),
        Progress(console, f"study {kind.name}"),
    )
    written = make_tables(where.results) if read_facts(where.results / FACTS) else []
    if failed:
        told = "; ".join(f"{name} ({type(error).__name__}: {error})" for name, error in failed.items())
        raise StudyError(f"{len(failed)} of {len(plan.jobs)} jobs failed, run again to try them again: {told}")
    return written


def make_tables(results: Path) -> list[Path]:
    """Make a study's tables and figures again from its facts; nothing is run.

    Raises:
        StudyError: `results` holds no study, or one without facts.
    """
    record = read_record(results)
    facts = read_facts(results / FACTS)
    if not facts:
        raise StudyError(f"{results / FACTS} holds no facts, expected some; run the study")
    return write_outputs(results, kind_of(record.study).outputs(facts, record))
