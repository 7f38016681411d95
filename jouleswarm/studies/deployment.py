"""One job, as a worker runs it: a whole deployment with a broker of its own, reduced to facts."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from jouleswarm.common.errors import StudyError, usable
from jouleswarm.fleet.endings import signal_of
from jouleswarm.fleet.packages import command_of
from jouleswarm.studies.facts import Fact, read_facts
from jouleswarm.studies.files import write_atomically
from jouleswarm.studies.jobs import Job

SETTINGS, FACTS, OUTPUT = "settings.txt", "facts.csv", "output.log"
_BULKY = ("weights", "logs", "checkpoint")


def run_job(job: Job, work: Path, keep: bool) -> list[Fact]:
    """Run a job from nothing; whatever an earlier attempt left is deleted first.

    The deployment is led by a process of its own (`studies.child`), which ends it when this process ends, however
    that happens: so a worker may be killed, and may be of any kind and run several jobs at once.

    Args:
        job: what to run.
        work: folder that the job's own folder is made in, with the run directory in it.
        keep: leave weights and logs too; else they are deleted once the facts are known.

    Raises:
        StudyError: the deployment failed; the message is the last line that it printed.
    """
    folder = work / job.name
    with usable("--work", folder, StudyError):
        if folder.exists():
            shutil.rmtree(folder)
        job.write(folder)
    write_atomically(folder / SETTINGS, "\n".join(job.settings) + "\n")
    with (folder / OUTPUT).open("wb") as output:
        # In a session of its own: a Ctrl-C at the terminal is not for it. It ends when its stdin is closed.
        command = [*command_of("jouleswarm.studies.child"), str(folder), job.name]
        child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        code = child.wait()
    if code != 0:
        printed = (folder / OUTPUT).read_text(errors="replace").strip().splitlines()
        sent = signal_of(code)
        told = printed[-1] if printed else f"it printed nothing, {sent.name if sent else 'no cause told'}"
        raise StudyError(f"{told} (exit code {code}, see {folder})")
    facts = [fact.model_copy(update={"variant": job.variant}) for fact in read_facts(folder / FACTS)]
    if not keep:
        for name in _BULKY:
            shutil.rmtree(folder / job.name / name, ignore_errors=True)
    return facts
