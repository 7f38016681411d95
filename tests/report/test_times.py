"""Seconds in summary.json, in the report's table and in the figure of joules against seconds, worked out by hand.

Of the made-up run at 48 kbit/s up and down and 40 kbit/s between robots: the stage sends 60 kB up from each of two
clusters (10 s), computes 120 gradients (2.4 s) and sends 5 kB down to two robots one after the other (5/3 s); a round
of a task is 20 gradients (8 s) and two messages of 5 kB (2 s).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from jouleswarm.common.scenario.reading import with_prices
from jouleswarm.report.figures import write_figures
from jouleswarm.report.notes import notes
from jouleswarm.report.time_figure import time_figure
from jouleswarm.report.times import battery_tables, seconds_tables
from jouleswarm.runs.run import Run, load_run
from jouleswarm.runs.seconds import front
from jouleswarm.runs.summary import summarise

STAGE_S = 10 + 2.4 + 5 / 3


@pytest.fixture
def run(write_run: Any, facts: Any) -> Run:
    found = load_run(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)))
    return found.at(with_prices(found.scenario, ["energy.ul_bit_per_s=48e3", "energy.sl_bit_per_s=40e3"], "made-up"))


def test_the_summary_has_seconds_of_each_arm_and_task_and_null_where_no_rate_is_known(run: Run) -> None:
    told = summarise(run.scenario, run.rows, run.meter_rows)["arms"]
    assert told["maml"]["seconds"]["ml"]["total_s"] == pytest.approx(STAGE_S)
    assert told["maml"]["seconds"]["total"]["total_s"] == pytest.approx(STAGE_S + 60)
    second = told["fl"]["seconds"]["tasks"]["2"]
    assert second == pytest.approx(
        {"rounds": 20, "computing_s": 160, "communication_s": 40, "total_s": 200, "round_s": 10}
    )
    unknown = (run.summary or {})["arms"]["fl"]["seconds"]
    assert unknown["total"] == pytest.approx({"computing_s": 160, "communication_s": None, "total_s": None})


def test_the_table_stands_only_where_something_tells_of_time(run: Run) -> None:
    assert (
        seconds_tables(run, run.scenario.energy.model_copy(update={"ul_bit_per_s": None, "sl_bit_per_s": None})) == []
    )
    (table,) = seconds_tables(run, run.scenario.energy)
    assert table.title == "Seconds to learn"
    assert [row[1:] for row in table.rows] == [
        ["14.1", "40.0", "60.0", "74.1", "23.7"],
        ["-", "100.0", "200.0", "200.0", "40.0"],
    ]


def test_a_missing_rate_is_said_and_computing_shown(run: Run) -> None:
    (table,) = seconds_tables(run, run.scenario.energy.model_copy(update={"sl_bit_per_s": None}))
    assert "communication is not known" in table.title
    assert table.rows[1][1:] == ["-", "80.0", "160.0", "160.0", "-"]


def test_the_figure_has_an_arm_a_point_and_is_written_at_other_prices_too(run: Run) -> None:
    axes = time_figure(run, run.scenario.energy).axes[0]
    points = [tuple(each.get_offsets()[0]) for each in axes.collections]
    assert points == [pytest.approx((STAGE_S + 60, 3.18792), rel=1e-3), pytest.approx((200, 2.4528), rel=1e-3)]
    assert "time-x.svg" in [path.name for path in write_figures(run, run.scenario.energy, "-x")]


def test_the_front_leaves_out_what_another_beats() -> None:
    assert front({"a": (1, 5), "b": (2, 3), "c": (3, 4), "d": (2, 3), "e": (1, 6), "f": (9, 1)}) == ["a", "b", "d", "f"]


def test_the_report_tells_how_long_batteries_last(run: Run) -> None:
    # A round is 20 gradients at 2.04 J and 5 kB at 500 kb/J, 40.88 J: 24 rounds of 983 J. In maml robots 1 and 3 have
    # sent 60 kB up before, 2.4 J: 23 rounds of what is left.
    assert battery_tables(run, run.scenario.energy) == []
    (table,) = battery_tables(run, with_prices(run.scenario, ["energy.battery_j=983"], "made-up").energy)
    assert [row[1:] for row in table.rows] == [
        ["robot 1", "40.88 J", "23", "robot 2", "40.88 J", "24"],
        ["robot 1", "40.88 J", "24", "robot 1", "40.88 J", "24"],
    ]


def test_a_robot_whose_battery_was_empty_is_named(run: Run) -> None:
    assert not any(line.startswith("Batteries empty") for line in notes(run, run.scenario.energy))
    left = [row for row in run.rows if (row.arm, row.agent) != ("fl", 4) or row.round < 7]
    last = next(row for row in run.rows if (row.arm, row.agent, row.round) == ("fl", 4, 7))
    rows = [*left, last.model_copy(update={"learned": False})]
    told = notes(replace(run, rows=rows), run.scenario.energy)
    assert "Batteries empty: FL, no transfer: robot 4 after round 7." in told
