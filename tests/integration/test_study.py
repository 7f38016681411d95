"""A study as a user runs it: real deployments in Dask's worker processes."""

from __future__ import annotations

import contextlib
import csv
import os
import signal
from pathlib import Path
from typing import Any

import psutil

TOY = str(Path(__file__).parents[2] / "scenarios" / "toy.toml")
# No robot can reach a target of 1000: every arm lasts max_rounds.
SMALL = ("federation.target_reward=1000", "meta.t0=2", "learning.motions_per_round=6", "learning.batches_per_round=4")
ENDED_WITHIN_S = 60.0


def command(folder: Path, *overrides: str, seeds: int = 1) -> list[str]:
    sets = [part for each in (*SMALL, *overrides) for part in ("--set", each)]
    where = ["--work", str(folder / "work"), "--results", str(folder / "results")]
    small = ["--scenario", TOY, "--methods", "maml", "--seeds", str(seeds), "--workers", "1"]
    return ["jouleswarm", "study", "paper", *small, *where, *sets]


def facts(folder: Path) -> list[dict[str, str]]:
    with (folder / "results" / "facts.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def marked(mark: str) -> list[psutil.Process]:
    """Everything alive that was started with TEST_MARK=mark in its environment, whoever its parent is by now."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if process.environ().get("TEST_MARK") == mark and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def robots_learn(folder: Path) -> bool:
    return any('"phase":"fl"' in path.read_text() for path in folder.glob("work/*/*/rounds.jsonl"))


def test_the_paper_study_runs_to_its_tables_and_runs_nothing_twice(start: Any, tmp_path: Path) -> None:
    arguments = command(tmp_path, "federation.max_rounds=3", "meta.adapt_from=[1]")
    study = start.python(*arguments)
    assert study.ends() == 0, study.printed
    assert [(row["arm"], row["t0"], row["task"]) for row in facts(tmp_path)] == [
        ("maml-t1", "1", "0"), ("maml-t1", "1", "1"), ("maml-t1", "1", "2"),
        ("maml", "2", "0"), ("maml", "2", "1"), ("maml", "2", "2"),
        ("fl", "0", "1"), ("fl", "0", "2"),
    ]  # fmt: skip
    stages = [row for row in facts(tmp_path) if row["task"] != "0"]
    assert all((row["rounds"], row["learned"]) == ("3", "False") for row in stages)
    # 3 rounds, 2 robots of 4 gradients; each robot's weights once a round to its one neighbour.
    assert {row["gradients_robots"] for row in stages} == {"24"}
    assert len({row["sidelink_bytes"] for row in stages}) == 1
    # 6 motions a round: the meta-model of round 1 was learned from half of what went up until round 2.
    first, last = (float(row["uplink_bytes"]) for row in facts(tmp_path) if row["task"] == "0")
    assert last == 2 * first > 0
    tables = {path.name for path in (tmp_path / "results").iterdir()}
    assert {"facts.csv", "study.json", "table2.md", "energy.csv", "breakeven.svg", "fig4a.png"} <= tables
    runs = list((tmp_path / "work").glob("base-s001-*/base-s001-*"))
    assert len(runs) == 2  # MAML, and without
    assert all((run / "summary.json").exists() and not (run / "weights").exists() for run in runs)
    again = start.python(*arguments)
    assert again.ends() == 0, again.printed
    assert "2 jobs, 2 of them collected before" in again.printed


def test_ctrl_c_leaves_no_process_and_no_facts_of_the_job_it_cut_off(
    start: Any, eventually: Any, tmp_path: Path
) -> None:
    study = start.python(
        *command(tmp_path, "federation.max_rounds=5000", "meta.adapt_from=[]"), TEST_MARK=str(tmp_path)
    )
    eventually(lambda: robots_learn(tmp_path), "robots to learn")
    assert len(marked(str(tmp_path))) >= 9  # study, worker, leader, fork server, broker, data center, 4 robots
    os.killpg(study.process.pid, signal.SIGINT)  # as a terminal does
    assert study.ends(ENDED_WITHIN_S) == 130
    assert "Traceback" not in study.printed
    eventually(lambda: not marked(str(tmp_path)), "every process to end", ENDED_WITHIN_S)
    assert not list(tmp_path.glob("results/jobs/*"))
