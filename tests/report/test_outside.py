"""A meter's log beside the bill of the made-up run (see made_up_run): robot 1, task 1, arm fl, 10 rounds of 6 s."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.report.outside import Meters, outside_table
from jouleswarm.report.report import report
from jouleswarm.report.table import Table
from jouleswarm.runs.directory import TIMES
from jouleswarm.runs.metering import RowTime
from jouleswarm.runs.run import load_run
from jouleswarm.runs.summary import summarise
from tests.made_up_run import Facts

BEGIN_S = 1_700_000_000
LOG = "".join(f"{BEGIN_S + second},5.0,shelly1\n" for second in range(-30, 91, 10))  # 30 s more on both sides


@pytest.fixture
def path(write_run: Callable[..., Path], facts: Facts) -> Path:
    """Bytes are not counted; robot 1's rounds without transfer follow one upon the other from BEGIN_S on."""
    facts.rows[:] = [row.model_copy(update={"seconds": 6.0}) for row in facts.rows]
    return timed(write_run(), facts)


def timed(path: Path, facts: Facts) -> Path:
    with (path / TIMES).open("w") as file:
        for row in facts.rows:
            if (row.arm, row.agent) == ("fl", 1):
                whose = row.model_dump(include={"phase", "arm", "task", "agent", "round"})
                file.write(RowTime(time_s=BEGIN_S + 6 * row.round, **whose).model_dump_json() + "\n")
    return path


def table(path: Path, log: str = LOG, *names: str, shift_s: float = 0.0) -> Table:
    (path.parent / "power.csv").write_text(f"time,watt,name\n{log}")
    run = load_run(path)
    return outside_table(run, run.scenario.energy, Meters([path.parent / "power.csv"], names, shift_s))


def test_five_watts_for_a_minute_against_what_ten_rounds_are_priced_at(path: Path) -> None:
    found = table(path, LOG, "shelly1=agent-1")
    assert found.headings[2:] == ["measured", "priced", "computing", "ratio"]
    # 5.0 W x 60 s = 300 J; 10 rounds x 20 gradients x 2.04 J = 408 J; 300 / 408
    fl = ["fl clusters, agent-1", "60.0", "300 J", "408 J", "408 J", "0.735"]
    assert found.rows == [
        ["maml meta, agent-1", "0.0 of 18.0", "-", "0 J", "0 J", None],  # rows without times
        ["maml clusters, agent-1", "0.0 of 24.0", "-", "163.2 J", "163.2 J", None],
        fl,
        ["between rounds, agent-1", "0.0", "-", None, None, None],
    ]
    assert found.notes == [
        "Left out, before a process's first round or after its last: 6 of 13 samples of shelly1.",
        "Bytes were not counted: priced is computing alone.",
    ]


def test_bytes_are_in_the_price_where_they_were_counted(write_run: Callable[..., Path], facts: Facts) -> None:
    path = timed(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)), facts)
    # as above, and 10 messages of 5000 B to its neighbour at 500 kb/J: 0.8 J; rounds of 2 s with 4 s between them
    fl, between = table(path, LOG, "shelly1=agent-1").rows[2:]
    assert fl[1:] == ["20.0", "100 J", "408.8 J", "408 J", "0.245"]
    assert between[1:3] == ["36.0", "180 J"]


def test_a_gap_is_named_and_leaves_no_ratio(path: Path) -> None:
    log = "".join(f"{BEGIN_S + second},5.0,agent-1\n" for second in [*range(31), *range(50, 61)])
    found = table(path, log)
    assert found.rows[2][1:] == ["40.0 of 60.0", "200 J", "408 J", "408 J", None]
    assert found.notes[0] == (
        "agent-1: gaps between samples: 1, 20.0 s in all, the longest 20.0 s from 2023-11-14T22:13:50+00:00; joules of "
        "gaps are not known, nor counted."
    )


def test_a_log_of_another_time_says_both_and_a_shift_sets_it_right(path: Path) -> None:
    log = "".join(f"{BEGIN_S + 3600 + second},5.0,agent-1\n" for second in (0, 60))
    with pytest.raises(
        ConfigurationError,
        match=r"samples are from 2023-11-14T23:13:20\+00:00 to .*, rounds of the run from 2023-11-14T22:13:20\+00:00 "
        r"to 2023-11-14T22:14:20\+00:00: .*--meter-shift",
    ):
        table(path, log)
    assert table(path, log, shift_s=-3600.0).rows[2][-1] == "0.735"


@pytest.mark.parametrize(
    ("names", "told"),
    [
        ((), "'shelly1' is no process of this run, expected one of datacenter, agent-1, .*--meter-name 'shelly1="),
        (("shelly2=agent-1",), "--meter-name shelly2=agent-1: no such name, the logs of --meter have shelly1"),
        (("shelly1=agent-9",), "--meter-name shelly1=agent-9: 'agent-9' is no process of this run, expected one of"),
    ],
)
def test_a_name_that_is_nobodys_is_one_line(names: tuple[str, ...], told: str, path: Path) -> None:
    with pytest.raises(ConfigurationError, match=told):
        table(path, LOG, *names)


def test_a_run_from_before_there_were_times_says_so(write_run: Callable[..., Path]) -> None:
    with pytest.raises(ConfigurationError, match=r"has no times \(times\.jsonl\): run its scenario again"):
        table(write_run())


def test_the_report_ends_with_it_and_the_bill_stays(path: Path) -> None:
    table(path, LOG, "shelly1=agent-1")  # writes the log
    told = []
    for meters in (None, Meters([path.parent / "power.csv"], ["shelly1=agent-1"])):
        console = Console(file=io.StringIO(), width=160)
        report(path, meters=meters, console=console)
        told.append(console.file.getvalue())  # type: ignore[attr-defined]
    before, after = told[1].split("Joules measured by a meter")
    assert "0.735" in after
    assert told[0].startswith(before.rstrip())
