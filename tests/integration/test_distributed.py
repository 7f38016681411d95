"""A run on a Dask cluster, as a user makes one: a scheduler and workers as processes of their own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

TOY = str(Path(__file__).parents[2] / "scenarios" / "toy.toml")


def test_a_run_that_loses_a_worker_ends_as_on_one_machine(
    start: Any, read_run: Any, small: tuple[str, ...], small_run: Any, eventually: Callable[..., None], tmp_path: Path
) -> None:
    told, dask = tmp_path / "scheduler.json", "distributed.cli.dask"
    on = ("--host", "127.0.0.1", "--no-dashboard")
    start.python(f"{dask}_scheduler", *on, "--port", "0", "--scheduler-file", str(told))
    eventually(told.exists, "a scheduler")
    scratch = ("--nthreads", "1", "--no-nanny", "--local-directory", str(tmp_path / "scratch"))
    workers = [start.python(f"{dask}_worker", "--scheduler-file", str(told), *on, *scratch) for _ in range(2)]
    eventually(lambda: all("Registered to" in each.printed for each in workers), "two workers")

    path, sets = tmp_path / "out" / "r", [part for each in small for part in ("--set", each)]
    where = ("--scheduler", json.loads(told.read_text())["address"], "--out", str(path.parent), "--run-id", "r")
    run = start.jouleswarm("run", TOY, *where, "--no-figures", *sets)
    eventually((path / "rounds.jsonl").exists, "a round")
    workers[1].process.kill()
    assert run.ends() == 0, run.printed
    assert " is gone; another one is to go on with " in run.printed
    assert " goes on with " in run.printed
    done = read_run(path, run.printed)
    assert done.figures == small_run.figures
    assert done.weights == small_run.weights
    assert not (path / "state").exists()
    assert psutil.Process(workers[0].process.pid).children() == []
