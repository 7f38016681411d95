"""Measured joules in a report: a table of their own, and no price touches them."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from jouleswarm.common.meter.joules import JoulesRow
from jouleswarm.report.html import page
from jouleswarm.report.measured import measured_tables
from jouleswarm.report.report import report
from jouleswarm.runs.directory import JOULES
from jouleswarm.runs.run import load_run

Write = Callable[..., Path]


def row(client: str, phase: str, arm: str, activity: str, joules: float, how: str = "rapl") -> str:
    role = "datacenter" if client == "datacenter" else "robot"
    held = {"phase": phase, "arm": arm, "activity": activity, "seconds": 2 * joules, "cpu_s": 1, "joules": joules}
    return JoulesRow.model_validate({"client": client, "role": role, **held, "how": how}).model_dump_json() + "\n"


def measured(path: Path) -> Path:
    (path / JOULES).write_text(
        row("agent-1", "fl", "fl", "learning", 3.0)
        + row("agent-2", "fl", "fl", "learning", 4.0)
        + row("agent-1", "fl", "fl", "idle", 0.5)
        + row("datacenter", "maml", "maml", "learning", 8.0)
        + row("datacenter", "maml", "maml", "learning", 90.0, "nvml")
        + row("agent-1", "", "", "start", 1.0)
    )
    return path


def test_each_way_that_joules_were_had_has_its_own_table(write_run: Write) -> None:
    tables = measured_tables(load_run(measured(write_run())))
    assert [table.title for table in tables] == ["Measured joules (rapl)", "Measured joules (nvml)"]
    rapl, nvml = (table.rows for table in tables)
    assert rapl == [  # start, learning, comm., idle, all; seconds, idle
        ["start, robots", "1.0", "0.0", "0.0", "0.0", "1.0", "2.0", "0.0"],
        ["maml meta, center", "0.0", "8.0", "0.0", "0.0", "8.0", "16.0", "0.0"],
        ["fl clusters, robots", "0.0", "7.0", "0.0", "0.5", "7.5", "15.0", "1.0"],
    ]
    assert nvml == [["maml meta, center", "0.0", "90.0", "0.0", "0.0", "90.0", "180.0", "0.0"]]


def test_other_prices_leave_them_as_they_are_and_a_run_without_has_no_table(write_run: Write, tmp_path: Path) -> None:
    path, told = write_run(), []
    assert measured_tables(load_run(path)) == []
    measured(path)
    for changes in ((), ("energy.pk_w=100",)):
        console = Console(file=io.StringIO(), width=160)
        report(path, changes=changes, details=True, console=console)
        told.append(console.file.getvalue().split("Measured joules (rapl)")[1].split("Bytes delivered")[0])  # type: ignore[attr-defined]
    assert told[0] == told[1]
    run = load_run(path)
    assert "Measured joules (nvml)" in page(run, run.scenario.energy)
