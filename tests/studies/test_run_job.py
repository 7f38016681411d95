"""One job in a process of its own: what is left of it, and what is told when it fails."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from jouleswarm.common.errors import StudyError
from jouleswarm.studies.deployment import SETTINGS, run_job
from jouleswarm.studies.jobs import Job

ROOT = Path(__file__).parents[2]
WITHOUT_TASKS = Job("", 1, 'name = "x"\n', ("meta.t0=3",))


def test_a_deployment_that_fails_is_told_by_its_last_line_and_exit_code(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"scenario\.toml: tasks: Field required \(exit code 2, see "):
        run_job(WITHOUT_TASKS, tmp_path, keep=False)


def test_what_an_attempt_that_was_cut_off_has_left_is_deleted_first(tmp_path: Path) -> None:
    left = tmp_path / WITHOUT_TASKS.name / WITHOUT_TASKS.name / "rounds.jsonl"
    left.parent.mkdir(parents=True)
    left.touch()
    with pytest.raises(StudyError):
        run_job(WITHOUT_TASKS, tmp_path, keep=False)
    assert not left.exists()
    assert (tmp_path / WITHOUT_TASKS.name / SETTINGS).read_text() == "meta.t0=3\nseed=1\n"


def test_the_process_that_leads_a_deployment_ends_it_when_its_stdin_is_closed(tmp_path: Path) -> None:
    job = Job("", 1, (ROOT / "scenarios" / "toy.toml").read_text(), ())
    job.write(tmp_path)
    (tmp_path / SETTINGS).write_text("meta.t0=1000\n")
    command = [sys.executable, "-m", "jouleswarm.studies.child", str(tmp_path), "r"]
    reading, writing = os.pipe()
    os.close(writing)
    done = subprocess.run(command, cwd=ROOT, stdin=reading, capture_output=True, text=True, timeout=60)
    os.close(reading)
    assert done.returncode == 130
    assert done.stderr.splitlines()[-1].startswith("stopped")
    assert not (tmp_path / "facts.csv").exists()
