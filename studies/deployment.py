"""One job, as a worker runs it: a whole deployment with a broker of its own, reduced to facts."""

from __future__ import annotations

import multiprocessing
import shutil
from pathlib import Path

from rich.console import Console

from common.errors import StudyError
from common.scenario import load_scenario
from fleet.report_data import load_run
from fleet.run import run_deployment
from studies.collect import facts_of
from studies.facts import Fact
from studies.jobs import Job

_BULKY = ("weights", "logs", "checkpoint")


def run_job(job: Job, work: Path, keep: bool) -> list[Fact]:
    """Run a job from nothing; whatever an earlier attempt left is deleted first.

    Args:
        job: what to run.
        work: folder that the job's own folder is made in, with the run directory in it.
        keep: leave weights and logs too; else they are deleted once the facts are known.

    Raises:
        StudyError: this worker may not start processes, or the run is not complete.
        JouleSwarmError: the deployment failed.
    """
    if multiprocessing.current_process().daemon:
        raise StudyError(
            "this Dask worker is a daemonic process, which may start no processes; start workers with "
            "DASK_DISTRIBUTED__WORKER__DAEMON=False in their environment, or with --no-nanny"
        )
    folder = work / job.name
    if folder.exists():
        shutil.rmtree(folder)
    file = job.write(folder)
    options = ["--scenario", str(file), *(part for each in job.settings for part in ("--set", each))]
    quiet = Console(quiet=True, force_terminal=False)
    path = run_deployment(load_scenario(file, job.settings), options, job.name, folder, None, quiet)
    run = load_run(path)
    if run.status != "complete":
        raise StudyError(f"job {job.name}: the run is {run.status}, expected complete; see {path}")
    facts = [fact.model_copy(update={"variant": job.variant}) for fact in facts_of(run)]
    if not keep:
        for name in _BULKY:
            shutil.rmtree(path / name, ignore_errors=True)
    return facts
