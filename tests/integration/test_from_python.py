"""Runs led from Python: the example notebook as a script, and a plain script that is stopped."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

from jouleswarm import Run

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def notebook(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Run]:
    """What examples/notebook.py prints, and its run."""
    folder = tmp_path_factory.mktemp("notebook")
    command = [sys.executable, str(ROOT / "examples" / "notebook.py")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    (path,) = (folder / "runs").iterdir()
    return done.stdout, Run(path)


def test_the_notebook_runs_from_its_first_cell_to_its_last(notebook: tuple[str, Run]) -> None:
    printed, done = notebook
    assert re.search(r"^maml .*\n(?: .*\n)* +uplink +12 ", printed, re.M)  # 2 rounds of 6 motions of one robot
    assert f"<Run runs/{done.path.name}, complete>" in printed
    assert "gradients_support=8" in printed  # 2 rounds of 4 batches


def test_the_notebooks_run_is_priced_again_in_data_frames(notebook: tuple[str, Run]) -> None:
    _, done = notebook
    bill = done.bill()
    assert bill.loc["fl", "fl"]["computing_robots"] == pytest.approx(3 * 4 * 4 * 5.1 * 0.4)  # rounds x robots x batches
    assert (done.bill(ul_bit_per_j=20e3) / bill)["ml"]["uplink"]["maml"] == pytest.approx(10)
    facts = done.facts("maml")
    assert sum(flow.messages for flow in facts.flows if flow.link == "uplink") == 12
    assert facts.counts.fl.gradients_robots == 48
    assert (done.scenario.seed, len(done.rounds.query("phase == 'fl' and arm == 'fl'"))) == (3, 16)  # round 0 too


def test_a_script_is_stopped_as_the_command_is(tmp_path: Path, start: Any, eventually: Any) -> None:
    script = tmp_path / "plain.py"
    script.write_text(
        f"from jouleswarm import run\nrun('toy', seed=2, out={str(tmp_path)!r}, run_id='stopped', show=False)\n"
    )
    started = start(sys.executable, str(script), PYTHONPATH=str(ROOT))
    path = tmp_path / "stopped"
    eventually(lambda: (path / "rounds.jsonl").exists() and len(Run(path).rounds) > 4, "rounds of the run")
    going = Run(path)
    assert going.status == "running"
    assert going.meter["payload_bytes"].sum() > 0
    family = started.family
    started.process.send_signal(signal.SIGINT)
    assert started.ends() in (-signal.SIGINT, 130)
    assert "KeyboardInterrupt: stopped: " in started.printed
    assert f"jouleswarm run --resume {path}` goes on from there" in started.printed
    psutil.wait_procs(family, timeout=10)
    assert not any(process.is_running() for process in family)
    assert going.status == "interrupted"
    assert len(going.rounds) > 4
