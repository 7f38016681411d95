"""Runs the jobs of a study: those that are collected already are skipped, the others spread over workers."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from distributed import Client, as_completed

from jouleswarm.studies.facts import Fact, read_facts, write_facts
from jouleswarm.studies.jobs import Job
from jouleswarm.studies.progress import Progress

FACTS = "facts.csv"
RunJob = Callable[[Job], list[Fact]]
Cluster = Callable[[], AbstractContextManager[Client]]


def part_of(results: Path, job: Job) -> Path:
    """The file of one job's facts; that it exists is what makes a job collected."""
    return results / "jobs" / f"{job.name}.csv"


def collected(results: Path, jobs: Sequence[Job]) -> list[Fact]:
    """Facts of all jobs that are collected, in the order of the jobs, whatever order they ended in."""
    parts = [part_of(results, job) for job in jobs]
    return [fact for part in parts if part.exists() for fact in read_facts(part)]


def run_jobs(
    jobs: Sequence[Job], run: RunJob, results: Path, cluster: Cluster, progress: Progress
) -> dict[str, BaseException]:
    """Run what is not collected yet; returns the errors of jobs that failed, by the job's name.

    `facts.csv` in `results` is brought up to date after every job, so that a study that is cut short keeps what it
    has. With nothing left to run no cluster is started.
    """
    waiting = [job for job in jobs if not part_of(results, job).exists()]
    failed: dict[str, BaseException] = {}
    with progress:
        progress.begin(total=len(jobs), done=len(jobs) - len(waiting))
        if waiting:
            with cluster() as client:
                collect = functools.partial(_collect, results, jobs)
                _run(client, waiting, run, collect, progress, failed)
    write_facts(results / FACTS, collected(results, jobs))
    return failed


def _run(
    client: Client,
    jobs: Sequence[Job],
    run: RunJob,
    collect: Callable[[Job, list[Fact]], None],
    progress: Progress,
    failed: dict[str, BaseException],
) -> None:
    futures = {client.submit(run, job, pure=False, retries=0): job for job in jobs}
    try:
        for future in as_completed(futures):
            job = futures[future]
            error = future.exception()
            if error is None:
                collect(job, future.result())
            else:
                failed[job.name] = error
            progress.ended(job, error)
    finally:
        client.cancel(list(futures))


def _collect(results: Path, jobs: Sequence[Job], job: Job, facts: list[Fact]) -> None:
    write_facts(part_of(results, job), facts)
    write_facts(results / FACTS, collected(results, jobs))
