"""What a made-up run's verdict hangs on, worked out by hand; see made_up_run for its rows and bytes.

MAML: a stage of 2364.72 J of computing and 4.8 J of uplink, 0.8 J down, then 4 and 6 rounds of a cluster at 81.76 J:
3187.92 J. Without: 10 and 20 such rounds, 2452.8 J.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.breakeven import Savings
from jouleswarm.energy.literal import literal
from jouleswarm.report.budget import budget_table
from jouleswarm.report.figures import write_figures
from jouleswarm.report.why import breakeven_tables, uncertain_tables, why_tables
from jouleswarm.runs.breakeven import savings_of
from jouleswarm.runs.curves import curves
from jouleswarm.runs.run import Run, load_run
from jouleswarm.runs.summary import summarise
from tests.made_up_run import Facts


@pytest.fixture
def path(write_run: Callable[..., Path], facts: Facts) -> Path:
    facts.rows[:] = [row if row.learned is None else row.model_copy(update={"learned": True}) for row in facts.rows]
    return write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))


@pytest.fixture
def run(path: Path) -> Run:
    return load_run(path)


def test_what_learning_first_saved(run: Run) -> None:
    found = savings_of(run, "maml", Energy(), literal)
    # saved: 6 x 81.76 J and 14 x 81.76 J, each less 0.4 J that went down to the task's robots; both tasks are seen
    assert found == pytest.approx(Savings(2369.52, 817.2, 817.2, 2, 1226.4))
    (table,) = breakeven_tables(run, Energy())
    # 2 seen tasks save 1634.4 J of 2369.52 J: 2.9 tasks in all
    assert table.rows == [["MAML, t0 = 3", "2.37 kJ", "817.2 J", "817.2 J", "2", "3", "3"]]


def test_what_each_bill_hangs_on_and_where_the_verdict_turns(run: Run) -> None:
    (table,) = why_tables(run, Energy())
    held = {row[0]: row[2:] for row in table.rows}
    assert held["P_0"] == ["74.18%", "+0.7418", f"{590 * 1629.6 / 2364.72:.4g}"]  # 2364.72 of 3187.92 J; 735.12 J less
    assert held["P_k"][:2] == ["25.60%", "+0.2560"]  # 816 of 3187.92 J
    # 3187.92 + 816 x = 2452.8 + 2448 x, so that P_k is 1 + 735.12 / 1632 times as high
    assert held["P_k"][2] == f"{5.1 * (1 + 735.12 / 1632):.4g}"
    assert held["E_SL"][:2] == ["0.05%", "-0.0005"]  # 1.6 of 3187.92 J
    assert set(held) == {"P_0", "T_0", "gamma", "beta", "P_k", "T_k", "E_UL", "E_SL"}


def test_no_comparison_where_a_task_was_not_learned(write_run: Callable[..., Path], facts: Facts) -> None:
    run = load_run(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)))
    assert breakeven_tables(run, Energy()) == why_tables(run, Energy()) == []


def test_what_a_budget_reached(run: Run) -> None:
    points = curves(run, Energy())
    table = budget_table(points, "2.7kJ")
    # the stage costs 2370.32 J, then 163.52 J for a round of both clusters: two rounds, R is 27.5 and 18.3
    assert table.rows == [["maml", "2", "0%", "none", "22.9"], ["fl", "20", "100%", "1 2", "17.5"]]
    assert budget_table(points, "2 kJ").rows[0][3] == "not even its stage is paid for"
    # 120 gradients in the stage, 80 a round: task 1 is learned after 4
    assert budget_table(points, "440 gradients").rows[0] == ["maml", "4", "50%", "1", "45.8"]


def test_seconds_are_spent_where_rates_are_known(run: Run) -> None:
    with pytest.raises(ConfigurationError, match="seconds are not known of this run"):
        budget_table(curves(run, Energy()), "10 min")
    # a round: 20 batches of 0.4 s, and two messages of 40 kbit one after the other at 40 kbit/s
    points = curves(run, Energy(ul_bit_per_s=1e6, sl_bit_per_s=40e3))
    assert budget_table(points, "100 s").rows[1][:4] == ["fl", "10", "50%", "1"]


@pytest.mark.parametrize("budget", ["10", "kJ", "-1kJ", "0J", "1e999kJ", "10 apples", "1.2.3J"])
def test_a_budget_that_is_none_is_one_clear_line(run: Run, budget: str) -> None:
    with pytest.raises(ConfigurationError, match="expected a number and one of J, kJ"):
        budget_table(curves(run, Energy()), budget)


def test_ranges_of_constants_give_an_interval_and_how_likely_it_pays(run: Run) -> None:
    assert uncertain_tables(run, Energy()) == []
    # the arms cost the same at P_k = 7.397 W: a third of the range 5.397 to 8.397 W is above
    energy = Energy.model_validate({"pk_w": {"low": 5.39725, "high": 8.39725}})
    (table,) = uncertain_tables(run, energy)
    (maml, fl) = table.rows
    assert (maml[4], fl[4]) == ("33.3%", "")
    assert fl[2] == "3.315 kJ"  # 4.8 J and 2448 J x 6.89725 / 5.1


def test_figures_and_the_curve_as_csv(path: Path) -> None:
    run = load_run(path)
    written: list[Any] = [file.name for file in write_figures(run, run.scenario.energy)]
    assert {"learned.svg", "learned.csv", "why.svg"} <= set(written)
    first, *lines = (path / "figures" / "learned.csv").read_text().splitlines()
    assert first == "arm,round,joules,bits,seconds,gradients,motions,learned,share_learned,reward"
    assert lines[0].startswith("maml,0,2370.32,1120000,,120,")
    assert len(lines) == 7 + 21
